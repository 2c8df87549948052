"""
Coarse start: where in the reference the live frame lies, and how it wobbles.

Patches of the live image vote for one global offset (summed normalised correlations), then strips
of rows are matched around it; `start` lays a smooth camera path through their displacements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import cv2
import numpy as np

from ._kernels.match import ROOM, best_band, follow_bands, highest, listed, match_bands
from .motion import Grid
from .start import StripMatches
from .workers import Workers, beside, each, shared

SEARCH_WIDTH = 160  # px; both images are reduced to about this width of the live frame
PATCHES = 3  # per direction, for the global vote
STRIPS = 14  # bands of rows
PARTS = 3  # pieces of one band
BLOCKS = 4  # of bands, that threads take
WOBBLE = 3  # px at search width: what rolling shutter may move a patch from the global offset
EDGE = 3  # px of room that a piece needs to the reference's edge
SAME_PLACE = 2.0  # px at search width that a band may lie off the place it was matched around
MIN_CONTRAST = 2.0  # grey levels; flatter patches say nothing
MIN_PEAK = 0.4  # normalised correlation of a strip that counts
_NEAR = np.ones((2 * WOBBLE + 1,) * 2, np.uint8)


class CoarseSearch:
    """Finds start paths for live frames of one size against one reference."""

    def __init__(
        self, reference: np.ndarray, grid: Grid, search_fraction: float, executor: Workers
    ) -> None:
        self._grid = grid
        self._executor = executor
        self._factor = max(1, round(grid.live_shape[1] / SEARCH_WIDTH))
        self._reference = _reduced(reference, self._factor)
        self._textured = _local_contrast(self._reference)
        self._flat = np.append(self._reference, np.zeros(ROOM, np.float32))
        self._sums = cv2.integral2(self._reference, sdepth=cv2.CV_64F)
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
        table = self._tracked(small, corner)
        table[:, :4] *= self._factor
        offset = self._shift_of(small.shape, corner) * self._factor
        return StripMatches(table[:, :2], table[:, 2:4], table[:, 4:], offset, peak)

    def _tracked(self, small: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """
        Match bands of rows, each near where its neighbour lies: a frame may bend far.

        Starts at the band that matches best at the voted place and goes both ways. Returns X, Y,
        shift x, y and trust x, y of the n pieces that match, (n, 6) [reduced px].
        """
        height, width = max(8, small.shape[0] // STRIPS), small.shape[1] // PARTS
        tops = np.arange(0, small.shape[0] - height + 1, height)
        x, y = np.round(corner).astype(int)
        found = np.empty((len(tops), small.shape[1] // width, 7))
        counts = np.empty(len(tops), np.int64)
        reach = max(6, round(0.06 * small.shape[1]))
        data = (
            self._flat, *self._sums, self._textured, width, reach, EDGE, MIN_CONTRAST, MIN_PEAK,
            found, counts,
        )  # fmt: skip

        def run(first: int, last: int) -> None:
            match_bands(first, last, small, tops, height, x, y, *data)

        def follow(step: int) -> None:
            follow_bands(anchor, step, corner, SAME_PLACE, small, tops, height, *data)

        shared(self._executor, run, len(tops), small.size, parts=BLOCKS)
        anchor = best_band(found, counts, MIN_PEAK)
        down = beside(self._executor, partial(follow, 1))
        follow(-1)
        down()
        table = np.empty((counts.sum(), 6))
        listed(found, counts, MIN_PEAK, table)
        table[:, 2:4] += self._shift_of(small.shape, np.zeros(2))
        return table

    def _shift_of(self, shape: tuple[int, int], corner: np.ndarray) -> np.ndarray:
        """Displacement of the centre when the live corner lies at `corner` x, y (reduced px)."""
        rows, columns = self._reference.shape
        return corner + np.array([(shape[1] - columns) / 2.0, (shape[0] - rows) / 2.0])

    def _vote(self, small: np.ndarray) -> tuple[np.ndarray, float]:
        """Corner x, y of the live frame in the reference with the largest summed correlation."""
        shape, reference = small.shape, self._reference.shape
        room = [whole - own for whole, own in zip(reference, shape, strict=True)]
        reach = [math.ceil(self._fraction * own) for own in shape]
        low = [min(free, 0) - far for free, far in zip(room, reach, strict=True)]
        size = [max(room[k], 0) + reach[k] - low[k] + 1 for k in (0, 1)]
        votes = np.zeros(size, np.float32)
        counts = np.zeros(size, np.float32)
        patch = [own // PATCHES for own in shape]
        corners = [
            (row, col)
            for row in range(0, shape[0] - patch[0] + 1, max(1, patch[0]))
            for col in range(0, shape[1] - patch[1] + 1, max(1, patch[1]))
        ]

        def begin_of(corner: tuple[int, int]) -> tuple[int, ...]:
            """Row and column of the reference where the places of a patch begin."""
            return tuple(max(corner[k] + low[k] - WOBBLE, 0) for k in (0, 1))

        def end_of(corner: tuple[int, int]) -> tuple[int, ...]:
            return tuple(
                min(corner[k] + low[k] + size[k] - 1 + patch[k] + WOBBLE, reference[k])
                for k in (0, 1)
            )

        def scores_of(corner: tuple[int, int]) -> np.ndarray | None:
            """Correlate a patch wherever it may lie, each place as good as the best near it."""
            row, col = corner
            begin, end = begin_of(corner), end_of(corner)
            piece = small[row : row + patch[0], col : col + patch[1]]
            if any(end[k] - begin[k] < patch[k] for k in (0, 1)) or _spread(piece) < MIN_CONTRAST:
                return None
            return cv2.dilate(self._correlate(piece, begin, end), _NEAR)

        found = each(self._executor, scores_of, corners)
        for corner, scores in zip(corners, found, strict=True):
            if scores is not None:
                at = [place - corner[k] - low[k] for k, place in enumerate(begin_of(corner))]
                _add_at(votes, counts, scores, at)
        # a place that only few patches can see must not win by luck: shrink means of few patches
        score = votes / (counts + 3.0)
        row, col = np.unravel_index(int(score.argmax()), score.shape)
        count = counts[row, col]
        mean = float(votes[row, col] / count) if count else 0.0
        return np.array([col + low[1], row + low[0]], np.float64), mean

    def _correlate(
        self, piece: np.ndarray, begin: tuple[int, ...], end: tuple[int, ...]
    ) -> np.ndarray:
        """Correlations 0..1 of `piece` at every place inside reference[begin:end] (row, col)."""
        window = np.s_[begin[0] : end[0], begin[1] : end[1]]
        scores = cv2.matchTemplate(self._reference[window], piece, cv2.TM_CCOEFF_NORMED)
        height, width = piece.shape
        textured = self._textured[window][
            height // 2 : height // 2 + scores.shape[0], width // 2 : width // 2 + scores.shape[1]
        ]
        np.fmin(np.fmax(scores, 0.0, out=scores), 1.0, out=scores)  # 0 where OpenCV has no number
        return np.multiply(scores, textured, out=scores)


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


def _spread(image: np.ndarray) -> float:
    """Standard deviation of an image."""
    return float(cv2.meanStdDev(image)[1][0, 0])


def _add_at(votes: np.ndarray, counts: np.ndarray, scores: np.ndarray, at: Sequence[int]) -> None:
    """Add `scores` to `votes` with its corner at `at`, what sticks out is dropped."""
    begin = [max(place, 0) for place in at]
    end = [min(at[k] + scores.shape[k], votes.shape[k]) for k in (0, 1)]
    if end[0] <= begin[0] or end[1] <= begin[1]:
        return
    target = np.s_[begin[0] : end[0], begin[1] : end[1]]
    source = np.s_[begin[0] - at[0] : end[0] - at[0], begin[1] - at[1] : end[1] - at[1]]
    votes[target] += scores[source]
    counts[target] += 1.0


def sub_pixel_peak(scores: np.ndarray) -> tuple[float, ...] | None:
    """Place x, y, height and sharpness x, y of the highest correlation; None when too low."""
    found = np.empty(5)
    return tuple(found.tolist()) if highest(scores, MIN_PEAK, found) else None
