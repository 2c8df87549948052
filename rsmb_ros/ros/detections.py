"""Changes as vision_msgs/Detection2DArray, where that package is installed: it has no wheel."""

from __future__ import annotations

from typing import Any

import numpy as np

from rsmb_ros.core.types import Region, Result
from rsmb_ros.messages.factory import MessageFactory
from rsmb_ros.messages.outputs import Output

try:
    from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose
except ImportError:
    Detection2DArray = None

_TYPE = 'vision_msgs/msg/Detection2DArray'


def detections(result: Result, live: np.ndarray, factory: MessageFactory, header: Any) -> Any:
    """Return the changes of a result; what is static is only in ``~/regions_json``."""
    found = [_detection(region, header) for region in result.regions if region.kind == 'change']
    return Detection2DArray(header=header, detections=found)


def _detection(region: Region, header: Any) -> Any:
    msg = Detection2D(header=header, id='' if region.id is None else str(region.id))
    # The box holds whole pixels, and a pixel's own place is its centre.
    msg.bbox.center.position.x = region.x + (region.width - 1) / 2
    msg.bbox.center.position.y = region.y + (region.height - 1) / 2
    msg.bbox.size_x = float(region.width)
    msg.bbox.size_y = float(region.height)
    what = ObjectHypothesisWithPose()
    what.hypothesis.class_id = region.kind
    what.hypothesis.score = float(region.score)
    msg.results = [what]
    return msg


if Detection2DArray is None:
    OUTPUTS: tuple[Output, ...] = ()
    CLASSES: dict[str, type] = {}
else:
    OUTPUTS = (Output('regions', _TYPE, detections),)
    CLASSES = {_TYPE: Detection2DArray}
