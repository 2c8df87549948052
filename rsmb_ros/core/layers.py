"""
Static objects at other depths (Algorithm 1 of the report), and what of the background they hide.

What such an object uncovers or half covers cannot be judged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import cv2
import numpy as np

from ._kernels.cover import draw_masks, watch_cover
from .motion import CameraPath, Grid, homographies
from .render import Window
from .segmentation import Blob
from .workers import Workers, each

GAP = 0.04  # of the width: gaps in an object's outline that still belong to it
EDGE = 9  # px: an object's outline is known to half of this
NEAR_EDGE = 9  # px from the edge of the live frame, where little is judged: an object goes on
RIM = 0.02  # share of the exposure that makes a pixel a rim
STEP_PX = 2.0  # px an object moves between two looks at it; its outline, drawn by EDGE, has no gaps
SLIGHT = 1.5  # px of parallax, below which what an object uncovers is no more than its rim
APART = 6.0  # grey levels between it and the ground, from which on it matters which one is seen
SURE = 2  # in a cover; 1: perhaps, 0: not

NO_SHIFT = (0.0, 0.0)


@dataclass(frozen=True)
class Place:
    """Where a static object lies, and how well it fits there."""

    relative_depth: float  # d_l
    shift: tuple[float, float] = NO_SHIFT  # x, y beyond what the depth does to it [px]
    misfit: float = 1.0  # >= 1, its residuals over the frame's noise: rich texture fits less well


@dataclass(frozen=True, eq=False)
class Layer:
    """One static object at its place."""

    blob: Blob  # the part of the live image it explains
    sure: np.ndarray  # bool, shape of the blob's mask: not what it uncovers
    place: Place
    share: float  # of what the object covers, that the place explains, 0..1


@dataclass(frozen=True, eq=False)
class Front:
    """What hides the background at one depth."""

    place: Place
    window: Window  # the two masks' part of the live frame, as small as it can be
    inside: np.ndarray  # bool, surely covered during the whole exposure
    edge: np.ndarray  # bool, perhaps covered, or uncovered: cannot be judged
    parallax: float  # px, how far it lies from where the background's depth would put it

    @property
    def slight(self) -> bool:
        """Whether it and the ground may look alike at its outline."""
        return self.parallax < SLIGHT

    def unknown(self, own: np.ndarray, complete: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """
        Return what of the window cannot be judged, bool.

        `own` and `ground` are the display values of the two, `own` where it is `complete`.
        """
        edge = self.edge
        if self.slight:
            alike = (complete & (np.abs(own - ground) < APART)).astype(np.uint8)
            edge = edge & (cv2.erode(alike, np.ones((3, 3), np.uint8)) == 0)
        return edge | (self.inside & ~complete)

    @cached_property
    def core(self) -> tuple[slice, slice] | None:
        """The smallest box of `window` around what is surely covered; None: nothing is."""
        return bounds(self.inside)


class Fronts:
    """
    What the layers of one live frame hide; each front is worked out once.

    Parameters
    ----------
    path : CameraPath
        Of the live frame.
    executor : Workers
        Threads that share the work.

    """

    def __init__(self, path: CameraPath, executor: Workers) -> None:
        self._path = path
        self._executor = executor
        self._known: dict[tuple[Layer, ...], Front | None] = {}

    def of(self, layers: Sequence[Layer]) -> list[Front]:
        """Find where static objects hide the background, farthest first."""
        places = {layer.place for layer in layers}
        sets = [
            tuple(layer for layer in layers if layer.place == place)
            for place in sorted(places, key=lambda p: (p.relative_depth, p.shift), reverse=True)
        ]
        new = [pieces for pieces in sets if pieces not in self._known]
        drawn = each(self._executor, partial(_front, path=self._path), new)
        self._known.update(zip(new, drawn, strict=True))
        return [front for pieces in sets if (front := self._known[pieces])]


def _front(pieces: Sequence[Layer], path: CameraPath) -> Front | None:
    """Find where pieces at one place surely and perhaps are; None: nowhere."""
    place = pieces[0].place
    depth, shift = place.relative_depth, place.shift
    cover = _cover_in_reference(pieces, place, path)
    samples = path.samples_per_row(STEP_PX, stretch=max(1.0, 1.0 / depth))
    a_x, a_y, _, zeta, *_ = np.abs(path.row_centroids()).max(axis=0)
    parallax = (max(a_x, a_y) + zeta) * abs(1.0 / depth - 1.0) + math.hypot(*shift)
    blur = samples.max() * STEP_PX
    window = _around(pieces, path.grid.live_shape, math.ceil(parallax + blur) + EDGE)
    always, ever = _seen(cover, path, samples, window, depth, shift)
    _, uncovered = _seen(cover, path, samples, window, 1.0, NO_SHIFT)
    inside = always == SURE
    edge = ((ever > 0) | (uncovered > 0)) & ~inside
    box = bounds(inside | edge)
    if box is None:
        return None
    moved = max(_displacement(piece, path) for piece in pieces)
    return Front(place, within(window, box), inside[box], edge[box], moved)


def _displacement(piece: Layer, path: CameraPath) -> float:
    """Pixels between the middle of a layer and where the background's depth would put it."""
    rows, cols = piece.blob.box
    q = path.row_centroids()[rows].mean(axis=0)
    middle = np.array([cols.start + cols.stop, rows.start + rows.stop]) / 2.0
    seen = q[:2] + q[3] / path.grid.half_width * (middle - path.grid.center[:2])
    return math.hypot(*((1.0 / piece.place.relative_depth - 1.0) * seen + piece.place.shift))


@dataclass(frozen=True)
class _Cover:
    """Where layers lie in the reference, or beyond its ends."""

    values: np.ndarray  # uint8: SURE, 1 perhaps, 0 not; from a pixel to the next, both ways
    left: int  # column of the first value [px]
    top: int  # its row [px]


def _cover_in_reference(pieces: Sequence[Layer], place: Place, path: CameraPath) -> _Cover:
    """Draw the pieces at one place on the reference's grid, sure and perhaps."""
    coordinates = path.row_centroids()
    coordinates[:, :2] += place.relative_depth * np.asarray(place.shift)
    gaps = max(3, round(GAP * path.grid.reference_shape[1]))
    continued = [_continued(piece, path.grid.live_shape, gaps) for piece in pieces]
    mapped = []
    for _, blob in continued:
        rows = np.arange(blob.y, blob.y + len(blob.mask)).clip(0, len(coordinates) - 1)
        mapped.append(homographies(coordinates[rows], path.grid, place.relative_depth))
    corners = np.array(
        [_reach(blob, own, path.grid) for (_, blob), own in zip(continued, mapped, strict=True)]
    )
    left, top = (corners[:, 0].min(axis=0) - EDGE).tolist()
    right, bottom = (corners[:, 1].max(axis=0) + EDGE + 1).tolist()
    drawn = np.zeros((2, bottom - top, right - left), np.uint8)  # sure, perhaps
    for (sure, blob), own in zip(continued, mapped, strict=True):
        draw_masks(
            np.stack([sure, blob.mask]), blob.x, blob.y, own.reshape(-1, 9), path.grid.center,
            left, top, drawn,
        )  # fmt: skip
    outline = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (EDGE, EDGE))
    sure = cv2.erode(_without_gaps(drawn[0], EDGE), outline)
    perhaps = cv2.dilate(_without_gaps(drawn[1], gaps), outline)
    # between four pixels an image is a mixture of them: all count
    cell = {'kernel': np.ones((2, 2), np.uint8), 'anchor': (0, 0)}
    return _Cover(cv2.erode(sure, **cell) + cv2.dilate(perhaps, **cell), left, top)


def _continued(piece: Layer, shape: tuple[int, int], gaps: int) -> tuple[np.ndarray, Blob]:
    """
    Return where a piece surely is, and perhaps: beyond the live frame, where it reaches its edge.

    What goes on out of sight has gaps there, too, and they show where it has moved.
    """
    blob = piece.blob
    edges = [
        (blob.y, shape[0] - blob.y - blob.mask.shape[0]),
        (blob.x, shape[1] - blob.x - blob.mask.shape[1]),
    ]
    further = [tuple(gaps if gap < NEAR_EDGE else 0 for gap in pair) for pair in edges]
    if not any(map(any, further)):
        return piece.sure, blob
    perhaps = np.pad(blob.mask, further, mode='edge')
    (above, _), (before, _) = further
    return np.pad(piece.sure, further), Blob(perhaps, blob.x - before, blob.y - above)


def _reach(blob: Blob, mapping: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the first and last column and row ((x, y), (x, y)) of a blob in the reference."""
    height, width = blob.mask.shape
    center = grid.center
    x = np.array([blob.x, blob.x + width - 1]) - center[0]
    y = np.arange(blob.y, blob.y + height) - center[1]
    u, v, w = (
        line[:, :1] * x + (line[:, 1] * y + line[:, 2])[:, None]
        for line in np.moveaxis(mapping, 1, 0)
    )
    u, v = u / w, v / w
    corners = np.array([[u.min(), v.min()], [u.max(), v.max()]]) + center[2:]
    return np.rint(corners).astype(np.int64)


def _seen(
    cover: _Cover,
    path: CameraPath,
    samples: np.ndarray,
    window: Window,
    relative_depth: float,
    shift: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest of a cover that each pixel of a window sees, uint8."""
    least, greatest = np.empty(
        (2, window.bottom - window.top, window.right - window.left), np.uint8
    )
    duration = (1.0 - 2.0 * RIM) * path.exposure_rows  # what shows at an end for less is no rim
    watch_cover(
        window.top, window.left, cover.values, cover.left, cover.top, path.row_times, samples,
        path.control, path.first_time, path.knot_rows, duration, path.grid.focal_px,
        path.grid.center, 1.0 / relative_depth, np.asarray(shift), least, greatest,
    )  # fmt: skip
    return least, greatest


def _without_gaps(cover: np.ndarray, gaps: int) -> np.ndarray:
    """Close gaps of so many pixels in an object's cover (rows, cols) uint8 0/1."""
    cover = cv2.copyMakeBorder(cover, *[gaps] * 4, cv2.BORDER_CONSTANT, value=0)
    cover = cv2.morphologyEx(cover, cv2.MORPH_CLOSE, np.ones((gaps, gaps), np.uint8))
    return cover[gaps:-gaps, gaps:-gaps]


def bounds(mask: np.ndarray) -> tuple[slice, slice] | None:
    """Return the smallest box around a mask (M, N) bool, None where it is empty."""
    rows, cols = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1)


def within(window: Window, box: tuple[slice, slice]) -> Window:
    """Return the part of the live frame that a box of a window is."""
    rows, cols = box
    return Window(
        window.top + rows.start,
        window.top + rows.stop,
        window.left + cols.start,
        window.left + cols.stop,
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
