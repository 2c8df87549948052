"""The published topics, and the gate that closes them."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, String

from rsmb_ros.core.types import Result
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT, Output

from . import detections
from .endpoints import Audience, publisher
from .factory import RclpyFactory

INACTIVE = 'not active'  # a cause of dropped frames

_MESSAGE_CLASSES = {IMAGE: Image, ROWS: Float32MultiArray, TEXT: String, **detections.CLASSES}
_PUBLISHED = (*OUTPUTS, *detections.OUTPUTS)


class _Made(NamedTuple):
    output: Output
    publisher: Any
    audience: Audience


class Outputs:
    """
    Publishers of a configured node; closed until `open`.

    Raises
    ------
    ConfigError
        If a QoS override cannot be used.

    """

    def __init__(self, node: Node, depth: int) -> None:
        self._node = node
        self._factory = RclpyFactory()
        self._gate = threading.Lock()
        self._closed = INACTIVE
        self._made: list[_Made] = []
        for output in _PUBLISHED:
            audience = Audience()
            made = publisher(
                node, _MESSAGE_CLASSES[output.type], f'~/{output.name}', depth, audience
            )
            self._made.append(_Made(output, made, audience))

    @staticmethod
    def topics(node: Node) -> list[str]:
        """Return the resolved names."""
        return [node.resolve_topic_name(f'~/{output.name}') for output in _PUBLISHED]

    def open(self) -> None:
        """Let results out."""
        with self._gate:
            self._closed = ''

    def close(self, cause: str) -> None:
        """Let no result out from now on, because of `cause`; waits for one that is on its way."""
        with self._gate:
            self._closed = cause

    def publish(self, result: Result, image: np.ndarray, header: Any) -> str:
        """Publish what somebody listens to; return '' or, if closed, why nothing was published."""
        with self._gate:
            if not self._closed:
                for output, made, audience in self._made:
                    if audience.present:
                        made.publish(output.build(result, image, self._factory, header))
            return self._closed

    def destroy(self) -> None:
        """Leave no publisher behind."""
        self.close(INACTIVE)
        while self._made:
            self._node.destroy_publisher(self._made.pop().publisher)
