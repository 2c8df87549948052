"""The messages of ROS 2 Jazzy, and of vision_msgs 4.1, which the library does not know."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_VISION = {
    'Point2D': 'float64 x\nfloat64 y',
    'Pose2D': 'vision_msgs/Point2D position\nfloat64 theta',
    'BoundingBox2D': 'vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y',
    'ObjectHypothesis': 'string class_id\nfloat64 score',
    'ObjectHypothesisWithPose': (
        'vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose'
    ),
    'Detection2D': (
        'std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n'
        'vision_msgs/BoundingBox2D bbox\nstring id'
    ),
    'Detection2DArray': 'std_msgs/Header header\nvision_msgs/Detection2D[] detections',
}

TYPES = get_typestore(Stores.ROS2_JAZZY)
for _name, _text in _VISION.items():
    TYPES.register(get_types_from_msg(_text, f'vision_msgs/msg/{_name}'))


def new(kind: str, **fields: Any) -> Any:
    """Return a message of type `kind` ('std_msgs/msg/String'); every field must be given."""
    return TYPES.types[kind](**fields)


def definition(kind: str) -> str:
    """Return the text that defines a type and all that it holds, as a recording carries it."""
    text, _ = TYPES.generate_msgdef(kind, ros_version=2)
    return text


def serialised(message: Any) -> bytes:
    """Return a message as CDR: what travels over ROS 2."""
    return bytes(TYPES.serialize_cdr(message, message.__msgtype__))


def deserialised(data: bytes, kind: str) -> Any:
    """Return the message of type `kind` that CDR holds."""
    return TYPES.deserialize_cdr(data, kind)
