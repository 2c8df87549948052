"""
Start the node `rsmb`.

    ros2 launch rsmb_ros rsmb.launch.py image:=/cam/image_raw reference:=/map/tile \
        camera_info:=/cam/camera_info params_file:=my.yaml

`ros2 launch rsmb_ros rsmb.launch.py --show-args` lists every argument.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

# argument -> (topic of the node, what it carries)
TOPICS = {
    'image': ('image', 'live images (Image, or CompressedImage on .../compressed)'),
    'reference': ('reference/image', 'the clean reference, likewise'),
    'depth': ('reference/depth', "the reference's depth (Image), if known"),
    'camera_info': ('camera_info', 'intrinsics (CameraInfo)'),
}
# Go before params_file, but only where given: an empty argument leaves what the file says.
PARAMETERS = {
    'image_transport': ('raw or compressed', str),
    'use_sim_time': ('true: time comes from /clock, as with a bag', bool),
    'autostart': ('false: the node waits for `ros2 lifecycle set`', bool),
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the node."""
    defaults = Path(get_package_share_directory('rsmb_ros')) / 'config' / 'rsmb.yaml'
    arguments = {
        'params_file': (str(defaults), 'YAML file with parameters; only what differs is needed'),
        'namespace': ('', 'namespace of the node and of its relative topics'),
        **{name: (topic, f'topic of {what}') for name, (topic, what) in TOPICS.items()},
        **{
            name: ('', f'parameter: {what}; empty: as in params_file')
            for name, (what, _) in PARAMETERS.items()
        },
        'log_level': ('info', 'debug, info, warn, error or fatal'),
        'respawn': ('false', 'true: start the node again, 2 s after it ended'),
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in arguments.items()
            ),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Node]:
    """Return the node as the arguments ask for it."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    parameters = {
        name: _truth(name, given(name)) if kind is bool else given(name)
        for name, (_, kind) in PARAMETERS.items()
        if given(name)
    }
    return [
        Node(
            package='rsmb_ros',
            executable='rsmb_node',
            name='rsmb',
            namespace=given('namespace'),
            parameters=[given('params_file'), *([parameters] if parameters else [])],
            remappings=[(topic, given(name)) for name, (topic, _) in TOPICS.items()],
            ros_arguments=['--log-level', given('log_level')],
            respawn=_truth('respawn', given('respawn')),
            respawn_delay=2.0,
            output='screen',
            emulate_tty=True,
        )
    ]


def _truth(name: str, text: str) -> bool:
    if text.lower() not in ('true', 'false'):
        raise ValueError(f'{name}:={text} must be true or false')
    return text.lower() == 'true'
