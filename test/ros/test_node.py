"""What cannot be seen from another process: the node in this one, its executor in a thread."""

import threading
from dataclasses import replace

import pytest

ANSWER_S = 60.0


@pytest.fixture
def built():
    """Names of the outputs that were built, in order."""
    return []


@pytest.fixture
def node(ros_environment, built, monkeypatch):
    """Yield a spinning node that records what it builds."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from rsmb_ros.ros import node as module
    from rsmb_ros.ros import outputs

    def recording(output):
        def build(*arguments):
            built.append(output.name)
            return output.build(*arguments)

        return replace(output, build=build)

    monkeypatch.setattr(outputs, '_PUBLISHED', tuple(map(recording, outputs._PUBLISHED)))
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = module.RsmbNode()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.create_task(node.start)
    spin = threading.Thread(target=executor.spin)
    spin.start()
    yield node
    assert node.stop(ANSWER_S)
    executor.shutdown()
    spin.join()
    node.destroy_node()
    rclpy.try_shutdown()


def test_output_is_built_only_while_somebody_subscribes(node, built, start_peer, scene):
    peer = start_peer(only=['row_motion'])
    peer.give_reference(scene.reference)
    msg = peer.message(scene.live, stamp_ns=1)
    peer.results_of(lambda: peer.image.publish(msg), 1, names=['row_motion'])
    assert set(built) == {'row_motion'}


def test_focal_length_is_taken_from_camera_info(node, start_peer):
    from sensor_msgs.msg import CameraInfo

    msg = CameraInfo()
    msg.k[0] = 512.5
    peer = start_peer(only=[])
    peer.wait_until(
        lambda: node._processing.intrinsics and node._processing.intrinsics.focal_px == 512.5,
        ANSWER_S,
        'focal length',
        repeat=lambda: peer.camera_info.publish(msg),
    )


def test_destroyed_node_is_gone_from_the_graph(ros_environment, start_peer):
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from rsmb_ros.ros.node import RsmbNode

    peer = start_peer(only=[])
    rclpy.init(
        args=['--ros-args', '-r', '__node:=mayfly'], signal_handler_options=SignalHandlerOptions.NO
    )
    node = RsmbNode()
    try:
        peer.wait_until(lambda: 'mayfly' in peer.node.get_node_names(), ANSWER_S, 'node')
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    peer.wait_until(lambda: 'mayfly' not in peer.node.get_node_names(), ANSWER_S, 'empty graph')
