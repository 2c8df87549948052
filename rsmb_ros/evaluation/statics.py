"""Static objects at other depths than the ground: is their depth found, are they called changes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from skimage.measure import label as components

from rsmb_ros.core.photometric import luma

from .case import Case, TrueMotion
from .matching import Box, iou
from .methods import Outcome

MIN_SHARE = 2.6e-4  # of the frame that an object must show, 80 px at 640x480
MIN_IOU = 0.25  # of the boxes of an object and the region that tells its depth
INNER = 3  # px inside its outline, where an object's own texture begins
ON_OBJECT = 0.5  # share of a reported change that lies on the object it is blamed on
RIM = 3  # px around objects that belong to them
UNCHANGED, OUTSIDE = 0, 85  # labels of CDnet


@dataclass(frozen=True)
class StaticObject:
    """One layer of a case, in view of the live frame."""

    depth: float  # true relative depth
    found: float  # relative depth of the region that matches it, NaN: none does
    texture: float  # mean gradient inside it [grey levels per px]
    parallax_px: float  # how far it has moved against the ground [px]
    blur_px: float  # of the frame, NaN: not known
    as_change: bool  # a region that touches no change lies mostly on it

    @property
    def error(self) -> float:
        """|found - true| relative depth, NaN where not found."""
        return abs(self.found - self.depth)


def static_objects(outcome: Outcome, case: Case, change: np.ndarray) -> tuple[StaticObject, ...]:
    """
    Say of each static object in view what a method makes of it.

    An object is a layer that shows at least `MIN_SHARE` of the frame, all of it in the reference.
    Its depth is that of the static region whose box matches its own best, from an IoU of `MIN_IOU`
    on: pieces of an object are not the object. Nothing where nothing is registered.

    Parameters
    ----------
    outcome : Outcome
    case : Case
    change : ndarray of shape (M, N), bool
        Reported as changed and judged.

    """
    motion = case.motion
    if motion is None or not outcome.registered:
        return ()
    found = [(box_of(mask), depth) for mask, depth in outcome.depths if mask.any()]
    alarms = _alarms(change, case.label)
    blur = case.about.get('blur_px', math.nan)
    slope = _slope(case, motion)
    objects = []
    for number, depth in enumerate(motion.depths, 1):
        mask = motion.layers == number
        if mask.sum() < MIN_SHARE * mask.size or (case.label[mask] == OUTSIDE).any():
            continue
        inner = _shrunk(mask)
        objects.append(
            StaticObject(
                depth=depth,
                found=_depth_at(box_of(mask), found),
                texture=float(slope[inner if inner.any() else mask].mean()),
                parallax_px=_parallax(motion, mask, depth),
                blur_px=float(blur) if isinstance(blur, (int, float)) else math.nan,
                as_change=_blamed(_grown(mask), alarms),
            )
        )
    return tuple(objects)


def box_of(mask: np.ndarray) -> Box:
    """Box x, y, width, height of a mask (M, N) bool that holds something [px]."""
    rows, cols = np.nonzero(mask)
    left, top = int(cols.min()), int(rows.min())
    return left, top, int(cols.max()) - left + 1, int(rows.max()) - top + 1


def _depth_at(box: Box, found: Iterable[tuple[Box, float]]) -> float:
    best = max(((iou(box, other), depth) for other, depth in found), default=(0.0, math.nan))
    return best[1] if best[0] >= MIN_IOU else math.nan


def _parallax(motion: TrueMotion, mask: np.ndarray, depth: float) -> float:
    """Return how far a layer has moved against the ground, mean over its rows [px]."""
    moved = motion.centroids[mask.any(axis=1), :2].mean(axis=0)
    return float(np.hypot(*moved) * abs(1.0 / depth - 1.0))


def _alarms(change: np.ndarray, label: np.ndarray) -> list[np.ndarray]:
    """Masks (M, N) bool of the reported regions that touch nothing that is or may be changed."""
    regions = components(change, connectivity=2)
    apart = [int(n) for n in np.unique(regions) if n and (label[regions == n] == UNCHANGED).all()]
    return [regions == n for n in apart if (regions == n).sum() >= MIN_SHARE * regions.size]


def _blamed(mask: np.ndarray, alarms: Iterable[np.ndarray]) -> bool:
    return any((alarm & mask).sum() >= ON_OBJECT * alarm.sum() for alarm in alarms)


def _slope(case: Case, motion: TrueMotion) -> np.ndarray:
    """Gradient (M, N) float32 of what the live camera sees without noise, if that is known."""
    seen = luma(case.live if motion.clean is None else motion.clean)
    gradients = [cv2.Scharr(seen, cv2.CV_32F, *way, scale=1 / 32) for way in ((1, 0), (0, 1))]
    return np.hypot(*gradients)


def _shrunk(mask: np.ndarray) -> np.ndarray:
    size = 2 * INNER + 1
    wide = np.pad(mask, 1).astype(np.uint8)
    return cv2.erode(wide, np.ones((size, size), np.uint8))[1:-1, 1:-1] > 0


def _grown(mask: np.ndarray) -> np.ndarray:
    size = 2 * RIM + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
