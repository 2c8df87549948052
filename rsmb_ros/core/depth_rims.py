"""Thin leftovers along static objects: what shows or hides at an edge of the depth is no change."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from .layers import Layer
from .segmentation import BASE_PIXELS, Blob, blobs, drawn

WIDTH = 7.0  # px, at 640x480: wider is no rim
SLENDER = 2.5  # times as long as wide at least
BESIDE = 26.0  # px between a rim and what of the object was explained, ...
LONG = 0.5  # ... or this share of the rim's length, if that is more


def depth_rims(mask: np.ndarray, layers: Sequence[Layer]) -> np.ndarray:
    """
    Find what of a mask (M, N) uint8 0/1 is only the rim of a static object, uint8 0/1.

    An edge of the depth hides and uncovers ground that no layer explains; a small parallax, or a
    roof that slopes, leaves long thin pieces beside the object.
    """
    if not layers:
        return np.zeros_like(mask)
    scale = float(np.sqrt(mask.size / BASE_PIXELS))
    objects = np.uint8(1) - drawn([layer.blob for layer in layers], mask.shape)
    far = cv2.distanceTransform(objects, cv2.DIST_C, 3)  # from the next object [px]
    rims = [
        blob
        for blob in blobs(mask)
        if _slender(blob, scale) and far[blob.box][blob.mask].min() <= _reach(blob, scale)
    ]
    return drawn(rims, mask.shape)


def _reach(blob: Blob, scale: float) -> float:
    """Return how far from a rim the object it belongs to may begin [px]: a long one's is large."""
    return max(BESIDE * scale, LONG * max(blob.mask.shape))


def _slender(blob: Blob, scale: float) -> bool:
    """Whether a blob is thin, and long for that."""
    inside = cv2.distanceTransform(np.pad(blob.mask.astype(np.uint8), 1), cv2.DIST_L2, 5)
    width = max(1.0, 2.0 * float(inside.max()) - 1.0)
    return width <= WIDTH * scale and blob.area >= SLENDER * width * width
