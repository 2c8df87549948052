"""What an active node listens to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from .endpoints import LATCHED, subscription
from .reception import Reception


class Topics(NamedTuple):
    """Resolved names of the inputs."""

    image: str
    reference: str
    depth: str
    camera_info: str

    @classmethod
    def of(cls, node: Node, compressed: bool) -> Topics:
        """Return the names after remapping; as in image_transport one of `image` moves all."""
        suffix = '/compressed' if compressed else ''
        return cls(
            node.resolve_topic_name('image') + suffix,
            node.resolve_topic_name('reference/image') + suffix,
            node.resolve_topic_name('reference/depth'),
            node.resolve_topic_name('camera_info'),
        )

    @property
    def rectified(self) -> bool:
        """Whether the name of the live images says that image_proc has rectified them."""
        return any(part.startswith('image_rect') for part in self.image.split('/'))


class Subscriptions:
    """Made on activation, gone after `destroy`."""

    def __init__(self, node: Node, topics: Topics, compressed: bool, reception: Reception) -> None:
        self._node = node
        self._made: list[Any] = []
        image = CompressedImage if compressed else Image
        for message_class, topic, callback, entity in _wanted(image, topics, reception):
            self._made.append(subscription(node, message_class, topic, callback, entity))

    def destroy(self) -> None:
        """Stop listening."""
        while self._made:
            self._node.destroy_subscription(self._made.pop())


def _wanted(image: type, topics: Topics, reception: Reception) -> Iterator[tuple]:
    # A volatile publisher matches only a volatile reader, and a latched image that was sent
    # before we started reaches only a transient-local one.
    for entity in (LATCHED, None):
        yield image, topics.reference, reception.reference, entity
        yield Image, topics.depth, reception.depth, entity
    yield CameraInfo, topics.camera_info, reception.camera_info, None
    # the last one: a frame must not come before what it is judged by can
    yield image, topics.image, reception.image, None
