"""What is built and published for whom; in this process, without the detector."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core.types import Result

DISCOVERY_S = 30.0


class Counting(Result):
    """A result that counts how often its views are asked for."""

    asked = 0

    @property
    def registered(self):
        """Count."""
        type(self).asked += 1
        return self.valid_mask


@pytest.fixture
def result():
    Counting.asked = 0
    blank = np.zeros((4, 6), np.uint8)
    return Counting(
        status='registered',
        reason='',
        change_mask=blank,
        valid_mask=blank,
        residual=blank.astype(np.float32),
        row_motion=np.zeros((4, 6)),
        row_uncertainty=np.zeros(4),
        regions=(),
        exposure_rows=1.0,
        gain=1.0,
        timings_ms={},
        views=SimpleNamespace(rectified=lambda: blank),
    )


@pytest.fixture
def desk(ros_environment):
    """Yield outputs of one node, another node to listen, and a way to wait for both."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from rsmb_ros.ros.outputs import Outputs

    class Desk:
        def __init__(self):
            self.context = rclpy.Context()
            rclpy.init(context=self.context)
            self.node = rclpy.create_node('rsmb', context=self.context)
            self.listener = rclpy.create_node('listener', context=self.context)
            self.executor = SingleThreadedExecutor(context=self.context)
            self.executor.add_node(self.node)
            self.executor.add_node(self.listener)
            self.outputs = Outputs(self.node, 5)
            self.outputs.open()

        def wait_until(self, done, what):
            deadline = time.monotonic() + DISCOVERY_S
            while not done():
                assert time.monotonic() < deadline, f'no {what} in {DISCOVERY_S} s'
                self.executor.spin_once(timeout_sec=0.02)

    desk = Desk()
    yield desk
    desk.outputs.destroy()
    desk.executor.shutdown()
    desk.listener.destroy_node()
    desk.node.destroy_node()
    rclpy.shutdown(context=desk.context)


def test_output_is_built_only_while_somebody_subscribes_to_it(desk, result):
    from sensor_msgs.msg import Image
    from std_msgs.msg import Header

    image, header = np.zeros((4, 6), np.uint8), Header(frame_id='cam')
    for _ in range(2):  # who leaves and comes back is heard of as well
        got = []
        subscription = desk.listener.create_subscription(Image, '/rsmb/registered', got.append, 5)

        def publish():
            assert desk.outputs.publish(result, image, header) == ''

        def arrived(got=got):
            publish()
            return bool(got)

        before = Counting.asked
        desk.wait_until(arrived, 'image for its subscriber')
        assert Counting.asked > before
        assert got[0].header.frame_id == 'cam'
        desk.listener.destroy_subscription(subscription)

        def left_alone():
            asked = Counting.asked
            publish()
            return Counting.asked == asked

        desk.wait_until(left_alone, 'end of publishing to nobody')


def test_middleware_without_matched_events_is_published_to_always(
    ros_environment, desk, result, monkeypatch
):
    from rclpy.event_handler import PublisherEventCallbacks, UnsupportedEventTypeError
    from std_msgs.msg import Header

    from rsmb_ros.ros.outputs import Outputs

    create = PublisherEventCallbacks.create_event_handlers

    def refuse(self, *args):
        if self.matched:
            raise UnsupportedEventTypeError('no matched events')
        return create(self, *args)

    monkeypatch.setattr(PublisherEventCallbacks, 'create_event_handlers', refuse)
    outputs = Outputs(desk.listener, 5)
    outputs.open()
    assert outputs.publish(result, np.zeros((4, 6), np.uint8), Header()) == ''
    assert Counting.asked == 1
    outputs.destroy()
