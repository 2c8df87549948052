"""What is used of a sensor_msgs/CameraInfo."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .errors import MalformedMessage

_LONGEST_PX = 1e5  # as of the parameter camera.focal_px
_DISTORTED = 1e-6  # a coefficient above this bends lines


@dataclass(frozen=True)
class Intrinsics:
    """What a camera_info tells of the image it belongs to."""

    focal_px: float  # focal length, of the binned image [px]
    width: int  # of the binned image [px]; 0: not told
    distorted: bool  # the lens bends straight lines


def intrinsics_from_msg(msg: Any) -> Intrinsics:
    """
    Return the intrinsics that a CameraInfo of ROS 2 or ROS 1 tells.

    Its matrix is that of the unbinned image.

    Raises
    ------
    MalformedMessage
        If there is no focal length, as in what an uncalibrated driver sends.

    """
    binning = max(int(msg.binning_x), 1)  # 0 means 1
    # ROS 1 calls them K and D
    k, d = (msg.K, msg.D) if hasattr(msg, 'K') else (msg.k, msg.d)
    focal_px = float(k[0]) / binning
    if not (math.isfinite(focal_px) and 0 < focal_px <= _LONGEST_PX):
        raise MalformedMessage(
            'focal length',
            f'k[0] = {float(k[0])} px, the focal length, must be above 0 and at most '
            f'{_LONGEST_PX:g} after binning by {binning}',
        )
    width = int(msg.roi.width) or int(msg.width)
    distorted = any(abs(value) > _DISTORTED for value in d)
    return Intrinsics(focal_px, width // binning, distorted)
