"""What a change looks like as a vision_msgs/Detection2D, for every library that makes messages."""

from __future__ import annotations

from typing import NamedTuple

from rsmb_ros.core.types import Region, Result

DETECTIONS = 'vision_msgs/msg/Detection2DArray'


class DetectionFields(NamedTuple):
    """Content of a vision_msgs/Detection2D beside its header."""

    id: str  # '' while it has none
    center_x: float  # of the bounding box [px]; a pixel's own place is its centre
    center_y: float  # [px]
    size_x: float  # [px]
    size_y: float  # [px]
    class_id: str
    score: float  # 0..1


def detection_fields(result: Result) -> list[DetectionFields]:
    """Return the changes of a result; what is static is only in ``regions_json``."""
    return [_fields(region) for region in result.changes]


def _fields(region: Region) -> DetectionFields:
    return DetectionFields(
        id='' if region.id is None else str(region.id),
        # the box holds whole pixels
        center_x=region.x + (region.width - 1) / 2,
        center_y=region.y + (region.height - 1) / 2,
        size_x=float(region.width),
        size_y=float(region.height),
        class_id=region.kind,
        score=float(region.score),
    )
