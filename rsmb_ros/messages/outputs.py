"""The one table of what is published for a frame; the node and the replay both walk it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsmb_ros.core.types import Result

from .as_json import summary_to_dict, to_json
from .factory import MessageFactory

IMAGE = 'sensor_msgs/msg/Image'
ROWS = 'std_msgs/msg/Float32MultiArray'
TEXT = 'std_msgs/msg/String'

# Builds the message from the result, the live image and the live image's header.
Builder = Callable[[Result, np.ndarray, MessageFactory, Any], Any]


@dataclass(frozen=True)
class Output:
    """One published topic."""

    name: str  # below the node's name: 'change_mask' -> ~/change_mask
    type: str  # ROS type, e.g. 'sensor_msgs/msg/Image'
    build: Builder


def _image(name: str) -> Output:
    """Return an output that carries the array `name` of the result as an Image."""

    def build(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
        return factory.image(header, getattr(result, name))

    return Output(name, IMAGE, build)


def _overlay(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
    from rsmb_ros.report.overlay import draw_overlay

    return factory.image(header, draw_overlay(live, result))


def _row_motion(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
    return factory.rows(result.row_motion, ('row', 'component'))


def _regions_json(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
    return factory.text(to_json(summary_to_dict(result, header.stamp, header.frame_id)))


OUTPUTS = (
    _image('registered'),
    _image('rectified'),
    _image('change_mask'),
    _image('valid_mask'),
    _image('residual'),
    Output('overlay', IMAGE, _overlay),
    Output('row_motion', ROWS, _row_motion),
    Output('regions_json', TEXT, _regions_json),
)
