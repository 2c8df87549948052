"""
Static objects at other depths (Algorithm 1 of the report), and what of the background they hide.

What such an object uncovers or half covers cannot be judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np

from .motion import CameraPath, shifted
from .render import Window, blurred
from .sampling import half_pixel
from .segmentation import Blob

GAP = 0.04  # of the width: gaps in an object's outline that still belong to it
EDGE = 9  # px: an object's outline is known to half of this
RIM = 0.02  # share of the exposure that makes a pixel a rim

NO_SHIFT = (0.0, 0.0)


@dataclass(frozen=True)
class Place:
    """Where a static object lies, and how well it fits there."""

    relative_depth: float  # d_l
    shift: tuple[float, float] = NO_SHIFT  # x, y beyond what the depth does to it [px]
    misfit: float = 1.0  # >= 1, its residuals over the frame's noise: rich texture fits less well


@dataclass(frozen=True)
class Layer:
    """One static object at its place."""

    blob: Blob  # the part of the live image it explains
    sure: np.ndarray  # bool, shape of the blob's mask: not what it uncovers
    place: Place
    share: float  # of the object that the place explains, 0..1


@dataclass(frozen=True)
class Front:
    """What hides the background at one depth."""

    place: Place
    window: Window  # the two masks' part of the live frame
    inside: np.ndarray  # bool, surely covered during the whole exposure
    edge: np.ndarray  # bool, perhaps covered, or uncovered: cannot be judged


def fronts(layers: Sequence[Layer], path: CameraPath, executor: Executor) -> list[Front]:
    """Find where static objects hide the background of a live frame, farthest first."""
    places = {layer.place for layer in layers}
    return [
        _front(place, [layer for layer in layers if layer.place == place], path, executor)
        for place in sorted(places, key=lambda p: (p.relative_depth, p.shift), reverse=True)
    ]


def _front(place: Place, pieces: list[Layer], path: CameraPath, executor: Executor) -> Front:
    """Render where pieces at one depth surely and perhaps are."""
    depth = place.relative_depth
    own_path = shifted(path, depth, place.shift)
    cover = half_pixel(_cover_in_reference(pieces, own_path))
    parallax = np.abs(path.row_centroids()[:, :2]).max() * abs(1.0 / depth - 1.0)
    window = _around(pieces, path.grid.live_shape, math.ceil(parallax) + _gaps(path) + EDGE)
    own, _ = blurred(cover, own_path, executor, depth, window)
    uncovered, _ = blurred(cover, path, executor, 1.0, window)
    inside = own > 1.0 - RIM / 2
    edge = ((own > RIM / 2) | (uncovered > RIM / 2)) & ~inside
    return Front(place, window, inside, edge)


def _gaps(path: CameraPath) -> int:
    return max(3, round(GAP * path.grid.reference_shape[1]))


def _cover_in_reference(pieces: list[Layer], path: CameraPath) -> np.ndarray:
    """1 where a layer surely lies in the reference, 1/2 where it may (rows, cols) float32."""
    rows, cols = path.grid.reference_shape
    cover = np.zeros((2, rows, cols), np.uint8)  # sure, perhaps
    for layer in pieces:
        for part, mask in zip(cover, (layer.sure, layer.blob.mask), strict=True):
            for u, v in _reference_places(layer, mask, path):
                inside = (u >= 0) & (v >= 0) & (u < cols) & (v < rows)
                part[v[inside], u[inside]] = 1
    outline = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (EDGE, EDGE))
    sure = cv2.erode(_without_gaps(cover[0], EDGE), outline)
    perhaps = cv2.dilate(_without_gaps(cover[1], _gaps(path)), outline)
    return (sure.astype(np.float32) + perhaps) / np.float32(2.0)


def _without_gaps(cover: np.ndarray, gaps: int) -> np.ndarray:
    """Close gaps of so many pixels in an object's cover (rows, cols) uint8 0/1."""
    cover = cv2.copyMakeBorder(cover, *[gaps] * 4, cv2.BORDER_CONSTANT, value=0)
    cover = cv2.morphologyEx(cover, cv2.MORPH_CLOSE, np.ones((gaps, gaps), np.uint8))
    return cover[gaps:-gaps, gaps:-gaps]


def _reference_places(
    layer: Layer, mask: np.ndarray, path: CameraPath
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield reference columns and rows of a part of the layer, one live row at a time."""
    center = path.grid.center
    homographies = path.row_homographies(layer.place.relative_depth)
    for row in range(mask.shape[0]):
        x = np.flatnonzero(mask[row]) + layer.blob.x
        y = row + layer.blob.y
        if y >= len(homographies) or not len(x):
            continue
        points = np.stack([x - center[0], np.full(len(x), y - center[1]), np.ones(len(x))])
        u, v, w = homographies[y] @ points
        yield (
            np.rint(u / w + center[2]).astype(np.int64),
            np.rint(v / w + center[3]).astype(np.int64),
        )


def padded(blob: Blob, shape: tuple[int, ...], pad: int) -> Window:
    """Return the window of a blob and `pad` px around it in a frame of `shape`."""
    height, width = blob.mask.shape
    return Window(
        max(0, blob.y - pad),
        min(shape[0], blob.y + height + pad),
        max(0, blob.x - pad),
        min(shape[1], blob.x + width + pad),
    )


def _around(pieces: Sequence[Layer], shape: tuple[int, ...], pad: int) -> Window:
    """Smallest window with `pad` px around all pieces."""
    windows = [padded(piece.blob, shape, pad) for piece in pieces]
    return Window(
        min(window.top for window in windows),
        max(window.bottom for window in windows),
        min(window.left for window in windows),
        max(window.right for window in windows),
    )
