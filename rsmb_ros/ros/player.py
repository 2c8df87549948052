"""A plain ROS node that publishes recorded messages."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from rsmb_ros.bags.reading import CAMERA_INFO, COMPRESSED, IMAGE
from rsmb_ros.messages.stamps import NS_PER_S

CLASSES = {IMAGE: Image, COMPRESSED: CompressedImage, CAMERA_INFO: CameraInfo}
_POLL_S = 0.02
_DEPTH = 5  # messages; a reliable reader that is late for a moment loses nothing
_STAMP_AT = 4  # header.stamp follows the four bytes of encapsulation


def restamped(data: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message that begins with a header, with another stamp [ns]."""
    order = _byte_order(data)
    stamp = struct.pack(f'{order}iI', *divmod(stamp_ns, NS_PER_S))
    return data[:_STAMP_AT] + stamp + data[_STAMP_AT + len(stamp) :]


def stamp_of(data: bytes) -> int:
    """Return the stamp [ns] of a serialised message that begins with a header."""
    sec, nanosec = struct.unpack_from(f'{_byte_order(data)}iI', data, _STAMP_AT)
    return sec * NS_PER_S + nanosec


def _byte_order(data: bytes) -> str:
    return '<' if data[1] & 1 else '>'


class Player:
    """
    Publishes serialised messages; close it in the end.

    Parameters
    ----------
    topics : mapping
        Topic -> type, 'sensor_msgs/msg/Image' and the like.
    latched : collection of str
        Topics whose last message is kept for readers that come later.
    check : callable
        Called all the time; ends the playing by an exception.

    """

    def __init__(
        self, topics: Mapping[str, str], latched: Collection[str], check: Callable[[], None]
    ) -> None:
        self._check = check
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)  # our own command line is none of ROS
        self.node = rclpy.create_node('rsmb_player', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers = {
            topic: self._publisher(topic, kind, topic in latched) for topic, kind in topics.items()
        }

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def publish(self, topic: str, data: bytes) -> None:
        """Publish a serialised message."""
        self._publishers[topic].publish(data)

    def listeners(self, topic: str) -> int:
        """Return how many subscribe to `topic`."""
        return self._publishers[topic].get_subscription_count()

    def spin_once(self, timeout_s: float = _POLL_S) -> None:
        """Take what comes for at most `timeout_s`."""
        self._check()
        self._executor.spin_once(timeout_sec=timeout_s)

    def spin_until(self, moment_s: float) -> None:
        """Take what comes until ``time.monotonic()`` is `moment_s`."""
        self._check()
        while (left := moment_s - time.monotonic()) > 0:
            self.spin_once(min(left, _POLL_S))

    def _publisher(self, topic: str, kind: str, latched: bool) -> Any:
        qos = QoSProfile(depth=1 if latched else _DEPTH)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        return self.node.create_publisher(CLASSES[kind], topic, qos)
