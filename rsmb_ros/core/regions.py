"""What a blob of the live frame is called in a result, and how sure that is."""

from __future__ import annotations

import math

import cv2
import numpy as np

from .layers import Layer
from .segmentation import Blob
from .types import Region

RIM_PX = 5  # px around a change that are looked at for what is unknown
# Logistic regression of 812 candidates with `threshold_high` at 3: suites planar, layered, regimes,
# far, light, weak-texture, photos, nochange, video, and some with their objects faded at random to
# 4 to 60 % of their contrast. 732 show a change, 80 do not, both kinds count equally much. Fitted
# on half of the cases, the area under the ROC curve is .91 on the other half (.87 to .93 in ten
# draws); held-out scores of .11 .29 .49 .70 .85 .96 were right in .13 .24 .52 .50 .62 1.0 of them.
PEAK_WEIGHT = 4.67  # per e-fold of the peak evidence; of its mean and the area no gain was measured
UNKNOWN_WEIGHT = -5.54  # per share of the rim: alarms lie where something could not be judged
OFFSET = -7.53
SHADOW_SHARE = 0.5  # of its score that what looks like a shadow keeps


def change_region(
    blob: Blob, strength: np.ndarray, judged: np.ndarray, shadow_like: bool = False
) -> Region:
    """
    Return what is new in the live frame.

    Parameters
    ----------
    blob : Blob
    strength : ndarray of shape (M, N), float32
        Evidence [sigma].
    judged : ndarray of shape (M, N), bool
    shadow_like : bool
        Whether only the light has changed there.

    """
    score = change_score(blob, strength, judged) * (SHADOW_SHARE if shadow_like else 1.0)
    return _region(blob, 'change', score, shadow_like=shadow_like)


def change_score(blob: Blob, strength: np.ndarray, judged: np.ndarray) -> float:
    """
    Return the probability that a blob shows a change, where every second candidate does, 0..1.

    It grows with the evidence. Where changes are rarer than that, so are right ones among those of
    one score: the odds score / (1 - score) are to be multiplied by those of the scene.
    """
    peak = max(float(strength[blob.box][blob.mask].max()), 1e-3)
    unknown = _unknown_share(blob, judged)
    logit = OFFSET + PEAK_WEIGHT * math.log(peak) + UNKNOWN_WEIGHT * unknown
    return 1.0 / (1.0 + math.exp(-logit))


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


def _region(
    blob: Blob, kind: str, score: float, depth: float | None = None, shadow_like: bool = False
) -> Region:
    rows, cols = np.nonzero(blob.mask)
    return Region(
        x=blob.x + int(cols.min()),
        y=blob.y + int(rows.min()),
        width=int(cols.max() - cols.min()) + 1,
        height=int(rows.max() - rows.min()) + 1,
        area=blob.area,
        kind=kind,
        score=score,
        relative_depth=depth,
        shadow_like=shadow_like,
    )
