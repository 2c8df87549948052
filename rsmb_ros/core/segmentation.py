"""From evidence to objects: hysteresis, closed outlines, connected regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ._kernels.regions import grow_regions
from .config import ChangeConfig

BASE_PIXELS = 640 * 480  # sizes below are px at this frame size
CLOSE_RADIUS = 5.0  # px, gaps in an outline that are closed
OUTLINE = 1.8  # of threshold_low, that an outline is drawn at
TIGHT_RADIUS = 5.0  # px, gaps in an object that are closed when its outline is drawn
TIGHT_SHARE = 0.35  # of an object that must show in the smaller window
FEW = 12  # regions whose boxes are compared sooner than all pixels are labelled
OPEN_SIZE = 5  # px, thinner leftovers along depth edges are not objects


@dataclass(frozen=True)
class Blob:
    """One connected set of pixels."""

    mask: np.ndarray  # (height, width) bool
    x: int  # left column [px]
    y: int  # top row [px]

    @property
    def area(self) -> int:
        """Number of pixels."""
        return int(np.count_nonzero(self.mask))

    @property
    def box(self) -> tuple[slice, slice]:
        """Index of the bounding box in an image."""
        height, width = self.mask.shape
        return np.s_[self.y : self.y + height, self.x : self.x + width]


def candidates(evidence: np.ndarray, config: ChangeConfig) -> np.ndarray:
    """
    Mark the pixels of possible objects in an evidence image (M, N) [sigma], (M, N) uint8 0/1.

    Regions grow over `threshold_low` from where `threshold_high` is reached; outlines are closed
    and filled.
    """
    scale = np.sqrt(evidence.size / BASE_PIXELS)
    size = 2 * max(1, round(CLOSE_RADIUS * scale)) + 1
    grown, box = _grown(evidence, config)
    mask, part = np.zeros_like(grown), grown[box]
    if part.size:
        # most of a frame is empty: what lies too far apart for one outline is closed by itself
        near = cv2.dilate(part, np.ones((size + 2, size + 2), np.uint8))
        for group in blobs(near):
            mask[box][group.box] |= _closed(part[group.box] * group.mask, size)
    return without_small(mask, config)


def _closed(mask: np.ndarray, size: int) -> np.ndarray:
    """Close gaps of nearly `size` px in outlines of a mask (M, N) uint8 0/1, and fill them."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    # a frame of background, else closing glues regions to the image's border
    wide = cv2.copyMakeBorder(mask, *[size] * 4, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, disc)[size:-size, size:-size]
    return cv2.morphologyEx(filled(closed), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))


def outline_level(config: ChangeConfig) -> float:
    """Return the evidence of the smaller window that outlines are drawn at [sigma]."""
    return OUTLINE * config.threshold_low


def tightened(mask: np.ndarray, sharp: np.ndarray, level: float) -> np.ndarray:
    """
    Draw the outlines of objects in a mask (M, N) uint8 0/1 where the residual begins.

    `mask` is as wide as the window of the evidence it was found by; `sharp` (M, N) [sigma] is
    evidence of a smaller window, and `level` what it reaches inside. An object keeps its outline
    where too little of it shows there.
    """
    scale = np.sqrt(mask.size / BASE_PIXELS)
    size = 2 * max(1, round(TIGHT_RADIUS * scale)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    result = np.zeros_like(mask)
    for blob in blobs(mask):
        inside = np.pad((sharp[blob.box] > level) & blob.mask, size)
        closed = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_CLOSE, disc)
        tight = filled(closed)[size:-size, size:-size] & blob.mask
        seen = np.count_nonzero(tight) > TIGHT_SHARE * blob.area
        result[blob.box] |= tight if seen else blob.mask
    return result


def filled(mask: np.ndarray) -> np.ndarray:
    """Fill the holes of a mask (M, N) uint8 0/1."""
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros_like(mask)
    cv2.drawContours(filled, outlines, -1, 1, cv2.FILLED)
    return filled


def hysteresis(evidence: np.ndarray, config: ChangeConfig) -> np.ndarray:
    """
    Keep what exceeds `threshold_low` and is connected to `threshold_high`, (M, N) uint8 0/1.

    One pixel is taken off all around: the evidence's window widens everything.
    """
    return _grown(evidence, config)[0]


def _grown(evidence: np.ndarray, config: ChangeConfig) -> tuple[np.ndarray, tuple[slice, slice]]:
    """Return the regions of `hysteresis`, and a box that holds them and a pixel around them."""
    mask = np.zeros(evidence.shape, np.uint8)
    waiting, edges = np.empty(evidence.size, np.int32), np.empty(4, np.int64)
    low, high = np.float32(config.threshold_low), np.float32(config.threshold_high)
    grow_regions(np.ascontiguousarray(evidence), low, high, waiting, mask, edges)
    top, left, bottom, right = (int(edge) for edge in edges)
    if bottom == 0:
        return mask, np.s_[:0, :0]
    return mask, np.s_[max(0, top - 1) : bottom + 1, max(0, left - 1) : right + 1]


def without_small(mask: np.ndarray, config: ChangeConfig) -> np.ndarray:
    """Drop connected regions below `min_area` from a mask (M, N) uint8 0/1."""
    return without_pieces(mask, config.min_area * mask.size)


def without_pieces(mask: np.ndarray, least: float) -> np.ndarray:
    """Drop connected regions below `least` pixels."""
    result = mask.copy()
    for blob in blobs(mask):
        if blob.area < least:
            result[blob.box][blob.mask] = 0
    return result


def without_weak(mask: np.ndarray, evidence: np.ndarray, config: ChangeConfig) -> np.ndarray:
    """Drop connected regions whose evidence (M, N) [sigma] nowhere reaches `threshold_high`."""
    result = mask.copy()
    for blob in blobs(mask):
        if evidence[blob.box][blob.mask].max() < config.threshold_high:
            result[blob.box][blob.mask] = 0
    return result


def without_thin(mask: np.ndarray) -> np.ndarray:
    """Drop what is thinner than a few pixels from a mask (M, N) uint8 0/1."""
    return cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((OPEN_SIZE, OPEN_SIZE), np.uint8))


def blobs(mask: np.ndarray) -> list[Blob]:
    """Split a mask (M, N) uint8 0/1 into its connected regions, top to bottom."""
    left, top, width, height = cv2.boundingRect(mask)
    if width == 0:
        return []
    part = mask[top : top + height, left : left + width]
    # boxes by outlines: OpenCV's own statistics of the regions take longer than all of this
    outlines, nesting = cv2.findContours(part, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    outer = [one for one, (*_, hole) in zip(outlines, nesting[0], strict=True) if hole < 0]
    boxes = [cv2.boundingRect(outline) for outline in outer]
    if _apart(boxes):  # what lies in a box is one region's
        masks = [part[y : y + h, x : x + w] > 0 for x, y, w, h in boxes]
    else:
        _, labels = cv2.connectedComponents(part, connectivity=8)
        own = [labels[tuple(outline[0, 0, ::-1])] for outline in outer]
        masks = [
            labels[y : y + h, x : x + w] == label
            for (x, y, w, h), label in zip(boxes, own, strict=True)
        ]
    found = [Blob(mask, left + x, top + y) for mask, (x, y, _, _) in zip(masks, boxes, strict=True)]
    return sorted(found, key=lambda blob: (blob.y, blob.x))


def _apart(boxes: Sequence[Sequence[int]]) -> bool:
    """Whether boxes x, y, width, height are few, and no two of them share a pixel."""
    return len(boxes) <= FEW and not any(
        max(x, u) < min(x + w, u + k) and max(y, v) < min(y + h, v + m)
        for n, (x, y, w, h) in enumerate(boxes)
        for u, v, k, m in boxes[:n]
    )


def drawn(found: list[Blob], shape: tuple[int, ...]) -> np.ndarray:
    """Draw blobs into an empty mask of `shape` (M, N), uint8 0/1."""
    mask = np.zeros(shape, np.uint8)
    for blob in found:
        mask[blob.box] |= blob.mask
    return mask
