"""
Start the node `rsmb`.

    ros2 launch rsmb_ros rsmb.launch.py image:=/cam/image_raw reference:=/map/tile \
        camera_info:=/cam/camera_info params_file:=my.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and the node."""
    defaults = Path(get_package_share_directory('rsmb_ros')) / 'config' / 'rsmb.yaml'
    arguments = {
        'params_file': (str(defaults), 'YAML file with parameters; only what differs is needed'),
        'namespace': ('', 'namespace of the node and of its relative topics'),
        'image': ('image', 'topic of the live images (sensor_msgs/Image)'),
        'reference': ('reference/image', 'topic of the clean reference (sensor_msgs/Image)'),
        'depth': (
            'reference/depth',
            "topic of the reference's depth (sensor_msgs/Image), if known",
        ),
        'camera_info': ('camera_info', 'topic of the intrinsics (sensor_msgs/CameraInfo)'),
    }
    topics = {
        'image': 'image',
        'reference': 'reference/image',
        'depth': 'reference/depth',
        'camera_info': 'camera_info',
    }
    node = Node(
        package='rsmb_ros',
        executable='rsmb_node',
        name='rsmb',
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file')],
        remappings=[(topic, LaunchConfiguration(name)) for name, topic in topics.items()],
        output='screen',
        emulate_tty=True,
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in arguments.items()
            ),
            node,
        ]
    )
