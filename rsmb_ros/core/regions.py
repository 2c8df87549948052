"""What a blob of the live frame is called in a result, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from .layers import Layer
from .segmentation import Blob
from .types import Region

RIM_PX = 5  # px around a change that are looked at for what is unknown
# Logistic regression of 847 candidates with `threshold_high` at 3, see `evaluation.score_fit`:
# seven suites and 182 other scenes, half of them unchanged, each change as it is and faded. 712
# show a change, 135 do not, both kinds count equally much. Fitted on one half and looked at on the
# other, the area under the ROC curve is .88 and .92; where the evidence is full, scores of .87 and
# .78 were right in .77 and .90. Few candidates lie between that and .3.
# Offset; per e-fold of the peak evidence (of its mean, the area, the texture and six more no gain
# was measured); per share of the rim that is unknown: alarms lie where something was not judged.
WEIGHTS = (-7.82, 4.10, -3.06)
SHADOW_SHARE = 0.5  # of its score that what looks like a shadow keeps


def change_region(blob: Blob, strength: np.ndarray, judged: np.ndarray) -> Region:
    """
    Return what is new in the live frame.

    Parameters
    ----------
    blob : Blob
    strength : ndarray of shape (M, N), float32
        Evidence [sigma].
    judged : ndarray of shape (M, N), bool

    """
    return _region(blob, 'change', change_score(blob, strength, judged))


def in_shade(region: Region) -> Region:
    """Return a change that is one of light only."""
    return replace(region, score=SHADOW_SHARE * region.score, shadow_like=True)


def change_score(blob: Blob, strength: np.ndarray, judged: np.ndarray) -> float:
    """
    Return the probability that a blob shows a change, where every second candidate does, 0..1.

    It grows with the evidence. Where changes are rarer than that, so are right ones among those of
    one score: the odds score / (1 - score) are to be multiplied by those of the scene.
    """
    offset, *weights = WEIGHTS
    logit = offset + float(traits_of(blob, strength, judged) @ weights)
    return 1.0 / (1.0 + math.exp(-logit))


def traits_of(blob: Blob, strength: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Return what the score of a change depends on, see `change_score`."""
    peak = max(float(strength[blob.box][blob.mask].max()), 1e-3)
    return np.array([math.log(peak), _unknown_share(blob, judged)])


def _unknown_share(blob: Blob, judged: np.ndarray) -> float:
    """Return how much of the rim around a blob, inside the frame, is not judged."""
    top, left = max(0, blob.y - RIM_PX), max(0, blob.x - RIM_PX)
    rows, cols = blob.box
    around = judged[top : rows.stop + RIM_PX, left : cols.stop + RIM_PX]
    rim = np.zeros(around.shape, np.uint8)
    height, width = blob.mask.shape
    own = np.s_[blob.y - top : blob.y - top + height, blob.x - left : blob.x - left + width]
    rim[own] = blob.mask
    rim = cv2.dilate(rim, np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8))
    rim[own][blob.mask] = 0
    return 1.0 - float(around[rim > 0].mean()) if rim.any() else 0.0


def static_region(layer: Layer) -> Region:
    """Return what was there at another depth."""
    return _region(layer.blob, 'static', min(1.0, layer.share), layer.place.relative_depth)


def _region(blob: Blob, kind: str, score: float, depth: float | None = None) -> Region:
    left, top, width, height = cv2.boundingRect(blob.mask.astype(np.uint8))
    return Region(
        x=blob.x + left,
        y=blob.y + top,
        width=width,
        height=height,
        area=blob.area,
        kind=kind,
        score=score,
        relative_depth=depth,
    )
