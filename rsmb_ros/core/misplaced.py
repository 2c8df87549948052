"""
What the reference shows a little beside: an edge that the path, or a depth, has not put in place.

A new object hides what was there. Where the ground comes back whole once it is moved by a pixel or
three, nothing hides it; but nothing says either what has changed there.
"""

from __future__ import annotations

import cv2
import numpy as np

from .agreement import correlation
from .coarse import sub_pixel_peak
from .frame import RegisteredFrame
from .segmentation import Blob

REACH = 4  # px that it may lie beside, less than that in fact, ...
LEAST = 0.5  # ... and must: what is in its place has another light
# Correlation with the ground, moved: what was misplaced has .91 to .99, objects up to .91 (538).
ALIKE = 0.93
SAME_LEVEL = 1.1  # largest factor between the means of the two: more is a shadow, ...
SAME_CONTRAST = (0.75, 1.33)  # ... and so is less contrast


def misplaced(blob: Blob, frame: RegisteredFrame) -> bool:
    """
    Say whether the prediction, moved by less than `REACH` px, shows what a blob of the frame shows.

    Parameters
    ----------
    blob : Blob
        Where the frame differs from its prediction.
    frame : RegisteredFrame
        Live frame and prediction, static objects in front.

    """
    seen = np.ascontiguousarray(frame.grey[blob.box])
    around = _around(frame.predicted, blob)
    mask = blob.mask.astype(np.float32)
    scores = cv2.matchTemplate(around, seen, cv2.TM_CCOEFF_NORMED, mask=mask)
    # even ground has no correlation
    peak = sub_pixel_peak(np.nan_to_num(scores, posinf=0.0, neginf=0.0))
    if peak is None or not all(0.0 < place < 2.0 * REACH for place in peak[:2]):
        return False
    if np.hypot(peak[0] - REACH, peak[1] - REACH) < LEAST:
        return False
    move = np.array([[1.0, 0.0, peak[0]], [0.0, 1.0, peak[1]]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(around, move, seen.shape[::-1], flags=flags)
    before, after = moved[blob.mask], seen[blob.mask]
    levels = float(before.mean()), float(after.mean())
    if max(levels) > SAME_LEVEL * min(levels):
        return False
    low, high = (share * float(before.std()) for share in SAME_CONTRAST)
    return low <= float(after.std()) <= high and correlation(before, after) >= ALIKE


def _around(image: np.ndarray, blob: Blob) -> np.ndarray:
    """Return an image (M, N) in the box of a blob and `REACH` px around, its edge continued."""
    height, width = blob.mask.shape
    rows = np.arange(blob.y - REACH, blob.y + height + REACH).clip(0, image.shape[0] - 1)
    columns = np.arange(blob.x - REACH, blob.x + width + REACH).clip(0, image.shape[1] - 1)
    return np.ascontiguousarray(image[np.ix_(rows, columns)])
