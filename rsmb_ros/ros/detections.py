"""Changes as vision_msgs/Detection2DArray, where that package is installed: it has no wheel."""

from __future__ import annotations

from typing import Any

import numpy as np

from rsmb_ros.core.types import Result
from rsmb_ros.messages.detections import DETECTIONS, DetectionFields, detection_fields
from rsmb_ros.messages.factory import MessageFactory
from rsmb_ros.messages.outputs import Output

try:
    from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose
except ImportError:
    Detection2DArray = None


def detections(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
    """Return the changes of a result."""
    found = [_detection(fields, header) for fields in detection_fields(result)]
    return Detection2DArray(header=header, detections=found)


def _detection(fields: DetectionFields, header: Any) -> Any:
    msg = Detection2D(header=header, id=fields.id)
    msg.bbox.center.position.x = fields.center_x
    msg.bbox.center.position.y = fields.center_y
    msg.bbox.size_x = fields.size_x
    msg.bbox.size_y = fields.size_y
    what = ObjectHypothesisWithPose()
    what.hypothesis.class_id = fields.class_id
    what.hypothesis.score = fields.score
    msg.results = [what]
    return msg


if Detection2DArray is None:
    OUTPUTS: tuple[Output, ...] = ()
    CLASSES: dict[str, type] = {}
else:
    OUTPUTS = (Output('regions', DETECTIONS, detections),)
    CLASSES = {DETECTIONS: Detection2DArray}
