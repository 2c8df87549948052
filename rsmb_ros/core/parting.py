"""Touching objects that changed together are told apart where only a neck joins them."""

from __future__ import annotations

import cv2
import numpy as np
from skimage.feature import peak_local_max
from skimage.segmentation import watershed

from .change_finder import Seen
from .config import ChangeConfig
from .segmentation import Blob, filled

NECK = 0.2  # of the smaller part's width, below which a neck parts; objects have such at .3
SPECKS = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))  # gaps that are noise
LEAST_SHARE = 0.2  # of the whole: neighbours are of a size, less is a piece of an object
WAIST = 0.92  # of the hull of two neighbours is in theirs: .84 to .9; in those of pieces .93 to 1
VALLEY = 0.7  # of the evidence of the weaker is between two: .4 to .6; in most cut objects more
BESIDE = np.ones((3, 3), np.uint8)
APART_PX = 3  # least distance of two middles: the outline is rough
# each pixel and its right, lower, lower right and lower left neighbour
SIDES = (
    (np.s_[:, :-1], np.s_[:, 1:]),
    (np.s_[:-1], np.s_[1:]),
    (np.s_[:-1, :-1], np.s_[1:, 1:]),
    (np.s_[:-1, 1:], np.s_[1:, :-1]),
)


def parted(blob: Blob, seen: Seen, judged: np.ndarray, config: ChangeConfig) -> list[Blob]:
    """
    Split a blob into the objects that only closing or weak evidence joins, top to bottom.

    Closing bridges the gaps between neighbours as it does those within an object. So the outline
    is where even the smaller window of `seen.sharp` shows less than `threshold_low`; what is not
    `judged` (M, N) bool is no outline. What is left may have grown together over weak evidence: it
    is parted where that falls off, if there is a waist. Parts do not touch.
    """
    parts = _split(blob, seen, judged, config, 0.0)
    finer = [one for part in parts for one in _parted_at_waist(part, seen, judged, config)]
    return sorted(finer, key=lambda part: (part.y, part.x))


def _parted_at_waist(
    blob: Blob, seen: Seen, judged: np.ndarray, config: ChangeConfig
) -> list[Blob]:
    """
    Split a blob where less than `threshold_high` joins parts that are more evident and rounder.

    An object whose outline has no waist is one, however weak it shows inside.
    """
    whole = _hull_area(blob)
    if blob.area >= WAIST * whole:  # then its parts fill the hull, too
        return [blob]
    parts = _split(blob, seen, judged, config, config.threshold_high)
    if sum(_hull_area(part) for part in parts) >= WAIST * whole:
        return [blob]
    strength = seen.strength[blob.box]
    between = blob.mask.copy()
    for part in parts:
        top, left = part.y - blob.y, part.x - blob.x
        height, width = part.mask.shape
        between[top : top + height, left : left + width] &= ~part.mask
    weakest = min(float(np.median(seen.strength[part.box][part.mask])) for part in parts)
    return parts if float(np.median(strength[between])) < VALLEY * weakest else [blob]


def _split(
    blob: Blob, seen: Seen, judged: np.ndarray, config: ChangeConfig, level: float
) -> list[Blob]:
    """
    Split a blob by watershed on the distance to its outline, where evidence exceeds `level`.

    Two parts stay one where the neck between them is wide, or where one of them is too small or
    too weak for an object. A line of one pixel between parts belongs to none.
    """
    box = blob.box
    shown = (seen.sharp[box] > config.threshold_low) & (seen.strength[box] > level) & blob.mask
    closed = cv2.morphologyEx(_padded(shown), cv2.MORPH_CLOSE, SPECKS)
    asked = _padded(judged[box], 1)
    depth = cv2.distanceTransform(1 - asked * (1 - filled(closed)), cv2.DIST_L2, 5)
    inside = _padded(blob.mask)
    depth *= inside
    if not _has_neck(depth):
        return [blob]
    padded = inside > 0
    tops = peak_local_max(depth, min_distance=APART_PX, labels=inside)
    if len(tops) < 2:
        return [blob]
    markers = np.zeros(padded.shape, np.int32)
    markers[tuple(tops.T)] = np.arange(1, len(tops) + 1)
    basins = watershed(-depth, markers, connectivity=2, mask=padded)
    strength = np.where(padded, np.pad(seen.strength[box], 1), np.float32(0.0))
    least = max(config.min_area * seen.strength.size, LEAST_SHARE * blob.area)
    owners = _joined(basins, depth, strength, least, config.threshold_high)
    labels = owners[basins]
    names = np.unique(labels[labels > 0])
    if len(names) < 2:
        return [blob]
    # a pixel beside one with a lower name is on the line
    first = cv2.erode(np.where(labels > 0, labels, len(owners)).astype(np.float32), BESIDE)
    labels[first < labels] = 0
    return [_cropped(labels[1:-1, 1:-1] == name, blob) for name in names]


def _padded(mask: np.ndarray, value: int = 0) -> np.ndarray:
    """Return a mask (M, N) bool with a rim of `value`, (M + 2, N + 2) uint8 0/1."""
    rim = (1, 1, 1, 1)
    return cv2.copyMakeBorder(mask.astype(np.uint8), *rim, cv2.BORDER_CONSTANT, value=value)


def _has_neck(depth: np.ndarray) -> bool:
    """
    Say whether a neck may part the distances to an outline (M, N) float32 [px], before a watershed.

    Of two parts, the smaller one w wide, no path of more than NECK w px from the outline joins the
    peaks: where such are apart, so are two regions of the distances that are at least t >= NECK w.
    It is looked for at t = 1, 2, 4...: smaller distances than 1 are 0.
    """
    peak, neck, least = float(depth.max()), 1.0, 0.0
    while least < peak:  # parts of a width in (least, neck / NECK]
        _, regions = cv2.connectedComponents((depth >= neck).view(np.uint8), connectivity=8)
        wide = regions[depth > least]
        if (wide != wide[0]).any():
            return True
        least, neck = neck / NECK, 2.0 * neck
    return False


def _hull_area(blob: Blob) -> float:
    """Pixels of the convex hull of a blob."""
    # no pixel but the first and last of a row is a corner of it
    rows = np.flatnonzero(blob.mask.any(axis=1))
    mask = blob.mask[rows]
    ends = mask.argmax(axis=1), mask.shape[1] - 1 - mask[:, ::-1].argmax(axis=1)
    corners = np.stack([np.concatenate(ends), np.tile(rows, 2)], axis=1).astype(np.int32)
    hull = cv2.convexHull(corners)
    x, y, width, height = cv2.boundingRect(hull)
    drawn = cv2.fillConvexPoly(np.zeros((y + height, x + width), np.uint8), hull, 1)
    return float(np.count_nonzero(drawn))


def _cropped(mask: np.ndarray, blob: Blob) -> Blob:
    """Return a part of a blob, given by a mask of the blob's box."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return Blob(mask[y : y + height, x : x + width], blob.x + x, blob.y + y)


def _joined(
    basins: np.ndarray, depth: np.ndarray, strength: np.ndarray, least: float, high: float
) -> np.ndarray:
    """
    Join basins (M, N) int32 1..n until the necks between them are narrow, (n + 1,) int64.

    `depth` is the distance to the outline [px], `least` the pixels and `high` the evidence that a
    part must have. Entry k is the part that basin k belongs to.
    """
    count = int(basins.max())
    width = np.zeros(count + 1)
    peak, area = width.copy(), np.bincount(basins.ravel(), minlength=count + 1).astype(float)
    np.maximum.at(width, basins.ravel(), depth.ravel())
    np.maximum.at(peak, basins.ravel(), strength.ravel())
    necks = _necks(basins, depth)
    owners = np.arange(count + 1)

    def urgency(pair: tuple[int, int]) -> float:
        """How wide a neck is, over the smaller part's width; what is no object comes first."""
        one, two = pair
        poor = min(area[one], area[two]) < least or min(peak[one], peak[two]) < high
        return necks[pair] / min(width[one], width[two]) + (2.0 if poor else 0.0)

    while necks:
        pair = max(necks, key=urgency)
        if urgency(pair) < NECK:
            break
        kept, gone = pair
        owners[owners == gone] = kept
        area[kept] += area[gone]
        width[kept] = max(width[kept], width[gone])
        peak[kept] = max(peak[kept], peak[gone])
        necks = _renamed(necks, gone, kept)
    return owners


def _necks(basins: np.ndarray, depth: np.ndarray) -> dict[tuple[int, int], float]:
    """Half the width of the widest passage between each two basins that touch [px]."""
    necks: dict[tuple[int, int], float] = {}
    for one, two in SIDES:
        a, b = basins[one], basins[two]
        touch = (a != b) & (a > 0) & (b > 0)
        pass_at = np.minimum(depth[one], depth[two])[touch]
        low, high = np.minimum(a, b)[touch], np.maximum(a, b)[touch]
        for left, right, width in zip(low.tolist(), high.tolist(), pass_at.tolist(), strict=True):
            necks[left, right] = max(necks.get((left, right), 0.0), width)
    return necks


def _renamed(
    necks: dict[tuple[int, int], float], gone: int, kept: int
) -> dict[tuple[int, int], float]:
    """Return the necks once a part has joined another."""
    renamed: dict[tuple[int, int], float] = {}
    for pair, width in necks.items():
        one, two = (kept if name == gone else name for name in pair)
        if one != two:
            key = (min(one, two), max(one, two))
            renamed[key] = max(renamed.get(key, 0.0), width)
    return renamed
