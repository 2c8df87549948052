"""
Coarse start: where in the reference the live frame lies, and how it wobbles.

Patches of the live image vote for one global offset (summed normalised correlations), then strips
of rows are matched around it and a smooth camera path is laid through their displacements.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import cv2
import numpy as np

from .motion import CameraPath, Grid, still_path
from .workers import each

SEARCH_WIDTH = 160  # px; both images are reduced to about this width of the live frame
PATCHES = 4  # per direction, for the global vote
STRIPS = 14  # bands of rows
PARTS = 3  # pieces of one band
WOBBLE = 3  # px at search width: what rolling shutter may move a patch from the global offset
EDGE = 3  # px of room that a piece needs to the reference's edge
SAME_PLACE = 2.0  # px at search width that a band may lie off the place it was matched around
MIN_CONTRAST = 2.0  # grey levels; flatter patches say nothing
MIN_PEAK = 0.4  # normalised correlation of a strip that counts
SPLINE_SAMPLES = 8  # instants per exposure in the start's design matrix


_Corner: TypeAlias = 'tuple[int, int] | np.ndarray'  # row, column
_Piece = tuple[float, ...]  # X, Y, shift x, y, weight x, y of one matched piece (reduced px)


@dataclass(frozen=True)
class StripMatches:
    """Displacements of n pieces of rows, in full-size pixels from the image centres."""

    place: np.ndarray  # (n, 2) centre X, Y of the piece in the live image [px from the centre]
    shift: np.ndarray  # (n, 2) reference place - live place [px]
    weight: np.ndarray  # (n, 2) trust in the two components, >= 0
    offset: np.ndarray  # (2,) global vote: where the live centre lies [px from the ref. centre]
    peak: float  # mean correlation of the vote's patches, 0..1; NaN without a vote


class CoarseSearch:
    """Finds start paths for live frames of one size against one reference."""

    def __init__(
        self, reference: np.ndarray, grid: Grid, search_fraction: float, executor: Executor
    ) -> None:
        self._grid = grid
        self._executor = executor
        self._factor = max(1, round(grid.live_shape[1] / SEARCH_WIDTH))
        self._reference = _reduced(reference, self._factor)
        self._textured = _local_contrast(self._reference)
        self._fraction = search_fraction

    def match(self, live: np.ndarray, near: np.ndarray | None = None) -> StripMatches:
        """
        Match a live image (M, N) float32 of display values.

        With `near`, the `offset` (2,) that a frame before it had [px], that is not searched for.
        No exception when nothing matches: `peak` is low and the pieces are few.
        """
        small = _reduced(live, self._factor)
        if near is None:
            corner, peak = self._vote(small)
        else:
            corner, peak = near / self._factor - self._shift_of(small.shape, np.zeros(2)), np.nan
        found = self._tracked(small, corner)
        table = np.array(found) if found else np.zeros((0, 6))
        table[:, :4] *= self._factor
        offset = self._shift_of(small.shape, corner) * self._factor
        return StripMatches(table[:, :2], table[:, 2:4], table[:, 4:], offset, peak)

    def _tracked(self, small: np.ndarray, corner: np.ndarray) -> list[_Piece]:
        """
        Match bands of rows, each near where its neighbour lies: a frame may bend far.

        Starts at the band that matches best at the voted place and goes both ways.
        """
        height = max(8, small.shape[0] // STRIPS)
        tops = range(0, small.shape[0] - height + 1, height)
        at_vote = each(
            self._executor, lambda top: list(self._band(small, top, height, corner)), tops
        )
        trust = [sum(min(piece[4], piece[5]) for piece in band) for band in at_vote]
        anchor = int(np.argmax(trust))
        bands = {anchor: at_vote[anchor]}
        for order in (range(anchor + 1, len(tops)), range(anchor - 1, -1, -1)):
            place = self._moved(small.shape, bands[anchor], corner)
            for n in order:
                near = np.abs(place - corner).max() <= SAME_PLACE
                bands[n] = at_vote[n] if near else list(self._band(small, tops[n], height, place))
                place = self._moved(small.shape, bands[n], place)
        return [piece for n in sorted(bands) for piece in bands[n]]

    def _moved(self, shape: tuple[int, int], band: list[_Piece], corner: np.ndarray) -> np.ndarray:
        """Return the live corner's place by the matches of one band, `corner` without any."""
        if not band:
            return corner
        best = max(band, key=lambda piece: min(piece[4], piece[5]))
        return np.array(best[2:4]) - self._shift_of(shape, corner * 0.0)

    def _shift_of(self, shape: tuple[int, int], corner: np.ndarray) -> np.ndarray:
        """Displacement of the centre when the live corner lies at `corner` x, y (reduced px)."""
        sizes = np.array(shape[::-1]), np.array(self._reference.shape[::-1])
        return corner + (sizes[0] - sizes[1]) / 2.0

    def _vote(self, small: np.ndarray) -> tuple[np.ndarray, float]:
        """Corner x, y of the live frame in the reference with the largest summed correlation."""
        shape = np.array(small.shape)
        room = np.array(self._reference.shape) - shape
        reach = np.ceil(self._fraction * shape).astype(int)
        low = np.minimum(room, 0) - reach
        size = np.maximum(room, 0) + reach - low + 1
        votes = np.zeros(size, np.float32)
        counts = np.zeros(size, np.float32)
        patch = shape // PATCHES
        corners = [
            (row, col)
            for row in range(0, shape[0] - patch[0] + 1, max(1, patch[0]))
            for col in range(0, shape[1] - patch[1] + 1, max(1, patch[1]))
        ]

        def begin_of(corner: tuple[int, int]) -> np.ndarray:
            """Row and column of the reference where the places of a patch begin."""
            return np.maximum(corner + low - WOBBLE, 0)

        def end_of(corner: tuple[int, int]) -> np.ndarray:
            return np.minimum(corner + low + size - 1 + patch + WOBBLE, self._reference.shape)

        def scores_of(corner: tuple[int, int]) -> np.ndarray | None:
            """Correlate a patch wherever it may lie, each place as good as the best near it."""
            row, col = corner
            piece = small[row : row + patch[0], col : col + patch[1]]
            if np.any(end_of(corner) - begin_of(corner) < patch) or piece.std() < MIN_CONTRAST:
                return None
            scores = self._correlate(piece, begin_of(corner), end_of(corner))
            return cv2.dilate(scores, np.ones((2 * WOBBLE + 1,) * 2, np.uint8))

        found = each(self._executor, scores_of, corners)
        for corner, scores in zip(corners, found, strict=True):
            if scores is not None:
                _add_at(votes, counts, scores, begin_of(corner) - corner - low)
        # a place that only few patches can see must not win by luck: shrink means of few patches
        score = votes / (counts + 3.0)
        row, col = np.unravel_index(int(score.argmax()), score.shape)
        count = counts[row, col]
        mean = float(votes[row, col] / count) if count else 0.0
        return np.array([col + low[1], row + low[0]], np.float64), mean

    def _correlate(self, piece: np.ndarray, begin: _Corner, end: _Corner) -> np.ndarray:
        """Correlations 0..1 of `piece` at every place inside reference[begin:end] (row, col)."""
        window = np.s_[begin[0] : end[0], begin[1] : end[1]]
        scores = cv2.matchTemplate(self._reference[window], piece, cv2.TM_CCOEFF_NORMED)
        height, width = piece.shape
        textured = self._textured[window][
            height // 2 : height // 2 + scores.shape[0], width // 2 : width // 2 + scores.shape[1]
        ]
        return np.fmin(np.fmax(scores, 0.0), 1.0) * textured  # 0 where OpenCV has no number

    def _band(
        self, small: np.ndarray, top: int, height: int, corner: np.ndarray
    ) -> Iterator[_Piece]:
        """Match the pieces of one band of rows around the live corner's place (reduced px)."""
        cols = small.shape[1]
        width = cols // PARTS
        reach = max(6, round(0.06 * cols))
        at = np.round(corner).astype(int)
        ref_rows, ref_cols = self._reference.shape
        base = self._shift_of(small.shape, corner * 0.0)
        for left in range(0, cols - width + 1, width):
            # the part of the piece that the reference can show within reach
            r0, r1 = max(top, EDGE - at[1]), min(top + height, ref_rows - at[1] - EDGE)
            c0, c1 = max(left, EDGE - at[0]), min(left + width, ref_cols - at[0] - EDGE)
            if r1 - r0 < 5 or c1 - c0 < 12:
                continue
            piece = small[r0:r1, c0:c1]
            if piece.std() < MIN_CONTRAST:
                continue
            begin = (max(0, r0 + at[1] - reach), max(0, c0 + at[0] - reach))
            end = (min(ref_rows, r1 + at[1] + reach), min(ref_cols, c1 + at[0] + reach))
            scores = self._correlate(piece, begin, end)
            found = sub_pixel_peak(scores)
            if found is None:
                continue
            dx, dy, peak, sharp_x, sharp_y = found
            place = ((c0 + c1 - cols) / 2.0, (r0 + r1 - small.shape[0]) / 2.0)
            shift = (begin[1] + dx - c0 + base[0], begin[0] + dy - r0 + base[1])
            trust = peak - MIN_PEAK + 0.05
            yield *place, *shift, min(1.0, 5 * sharp_x) * trust, min(1.0, 5 * sharp_y) * trust


def start_path(
    matches: StripMatches,
    grid: Grid,
    knot_rows: float,
    exposure_rows: float,
    longest_exposure: float,
    bottom_up: bool,
) -> CameraPath:
    """
    Lay a smooth path (offset, rotation, zoom) through the matches by robust least squares.

    With fewer than six matches the path is the global offset alone.
    """
    path = still_path(grid, knot_rows, exposure_rows, longest_exposure, bottom_up)
    knots = len(path.control)
    path.control[:, :2] = matches.offset
    if len(matches.place) < 6:
        return path
    row = np.clip(matches.place[:, 1] + grid.center[1], 0, grid.live_shape[0] - 1)
    times = np.interp(row, np.arange(grid.live_shape[0]), path.row_times)
    spline = _mean_basis(path, times)
    x, y = matches.place.T[:, :, None] / grid.half_width
    none = np.zeros_like(spline)
    design = np.concatenate(
        [
            np.hstack([spline, none, -y * spline, x * spline]),
            np.hstack([none, spline, x * spline, y * spline]),
        ]
    )
    target = matches.shift.T.ravel()
    weight = matches.weight.T.ravel()
    prior = _start_prior(knots)
    trust = weight
    for _ in range(6):
        normal = design.T @ (trust[:, None] * design) + prior
        solution = np.linalg.solve(normal, design.T @ (trust * target))
        misfit = np.hypot(*(target - design @ solution).reshape(2, -1))
        sigma = max(1.0, 1.4826 * float(np.median(misfit)))
        trust = weight * np.tile(1.0 / (1.0 + (misfit / (2 * sigma)) ** 2) ** 2, 2)
    path.control[:, :2] = solution.reshape(4, knots)[:2].T
    # the design is linear in s sin(r) and s cos(r) - 1
    turned, grown = solution.reshape(4, knots)[2:] / grid.half_width
    path.control[:, 2] = grid.half_width * np.arctan2(turned, 1.0 + grown)
    path.control[:, 3] = grid.half_width * (np.hypot(turned, 1.0 + grown) - 1.0)
    return path


@cache
def _start_prior(knots: int) -> np.ndarray:
    """Smoothness of the start: offsets may bend, rotation and zoom hardly change in a frame."""
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    slope, bend = first.T @ first, second.T @ second
    prior = np.zeros((4 * knots, 4 * knots))
    for n, (bend_weight, slope_weight, ridge) in enumerate(
        [(0.005, 0.01, 1e-9), (0.005, 0.01, 1e-9), (0.2, 2.0, 1e-3), (0.2, 4.0, 1e-2)]
    ):
        block = np.s_[n * knots : (n + 1) * knots]
        prior[block, block] = bend_weight * bend + slope_weight * slope + ridge * np.eye(knots)
    return prior


def _mean_basis(path: CameraPath, times: np.ndarray) -> np.ndarray:
    """Spline weights of each knot, averaged over the exposure around `times` (n, knots)."""
    shares = (np.arange(SPLINE_SAMPLES) + 0.5) / SPLINE_SAMPLES - 0.5
    instants = times[:, None] + shares * path.exposure_rows
    weights = path.spline_basis(instants.ravel())
    return weights.reshape(len(times), SPLINE_SAMPLES, -1).mean(axis=1)


def _reduced(image: np.ndarray, factor: int) -> np.ndarray:
    rows, cols = image.shape[0] // factor, image.shape[1] // factor
    whole = image[: rows * factor, : cols * factor]
    return cv2.resize(whole, (cols, rows), interpolation=cv2.INTER_AREA)


def _local_contrast(image: np.ndarray) -> np.ndarray:
    """1 where the neighbourhood has contrast, else 0: correlation of flat ground is noise."""
    mean = cv2.blur(image, (9, 9))
    variance = cv2.blur(image * image, (9, 9)) - mean * mean
    seen = (variance > 1.0).astype(np.uint8)
    return cv2.dilate(seen, np.ones((9, 9), np.uint8)).astype(np.float32)


def _add_at(votes: np.ndarray, counts: np.ndarray, scores: np.ndarray, at: np.ndarray) -> None:
    """Add `scores` to `votes` with its corner at `at`, what sticks out is dropped."""
    begin = np.maximum(at, 0)
    end = np.minimum(np.add(at, scores.shape), votes.shape)
    if np.any(end <= begin):
        return
    target = np.s_[begin[0] : end[0], begin[1] : end[1]]
    source = np.s_[begin[0] - at[0] : end[0] - at[0], begin[1] - at[1] : end[1] - at[1]]
    votes[target] += scores[source]
    counts[target] += 1.0


def sub_pixel_peak(scores: np.ndarray) -> tuple[float, ...] | None:
    """Place x, y, height and sharpness x, y of the highest correlation; None when too low."""
    row, col = np.unravel_index(int(scores.argmax()), scores.shape)
    peak = float(scores[row, col])
    inner = 0 < row < scores.shape[0] - 1 and 0 < col < scores.shape[1] - 1
    if peak < MIN_PEAK or not inner:
        return None
    place = [float(col), float(row)]
    sharp = []
    for axis, (a, c) in enumerate(
        [(scores[row, col - 1], scores[row, col + 1]), (scores[row - 1, col], scores[row + 1, col])]
    ):
        bend = float(2 * peak - a - c)
        place[axis] += float(c - a) / (2 * bend) if bend > 1e-6 else 0.0
        sharp.append(max(0.0, bend))
    return place[0], place[1], peak, sharp[0], sharp[1]
