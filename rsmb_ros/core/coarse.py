"""
Coarse start: where in the reference the live frame lies, and how it wobbles.

A vote tells where the whole frame lies, then strips of rows are matched around it; `start` lays a
smooth camera path through their displacements.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from ._kernels.match import ROOM, best_band, follow_bands, highest, listed, match_bands
from .motion import Grid
from .start import StripMatches
from .vote import MIN_CONTRAST, GlobalVote
from .workers import Workers, beside, shared

SEARCH_WIDTH = 160  # px; both images are reduced to about this width of the live frame
STRIPS = 14  # bands of rows
PARTS = 3  # pieces of one band
BLOCKS = 4  # of bands, that threads take
WOBBLE = 3  # px at search width: what rolling shutter may move a patch from the global offset
EDGE = 3  # px of room that a piece needs to the reference's edge
SAME_PLACE = 2.0  # px at search width that a band may lie off the place it was matched around
MIN_PEAK = 0.4  # normalised correlation of a strip that counts
# At half the size a vote takes a third of the time. It is taken where patches correlate so much
# and no other place does by so much of that: in 406 of 459 frames of all kinds, in none of which
# the vote at full size was more than 6 px away.
SURE, ALONE = 0.5, 0.8
QUICK_WOBBLE = 1  # px at half the size
LEAST_SIZE = 72  # px at search width; parts of smaller images are too small at half the size


class CoarseSearch:
    """Finds start paths for live frames of one size against one reference."""

    def __init__(
        self, reference: np.ndarray, grid: Grid, search_fraction: float, executor: Workers
    ) -> None:
        self._grid = grid
        self._executor = executor
        self._factor = max(1, round(grid.live_shape[1] / SEARCH_WIDTH))
        small = _reduced(reference, self._factor)
        self._shape = small.shape
        self._flat = np.append(small, np.zeros(ROOM, np.float32))
        self._sums = cv2.integral2(small, sdepth=cv2.CV_64F)
        self._votes = GlobalVote(small, search_fraction, WOBBLE, executor)
        self._textured = self._votes.textured
        self._quick: GlobalVote | None = None
        if min(*small.shape, *(length // self._factor for length in grid.live_shape)) >= LEAST_SIZE:
            half = _reduced(small, 2)
            self._quick = GlobalVote(half, search_fraction, QUICK_WOBBLE, executor)

    def match(self, live: np.ndarray, near: np.ndarray | None = None) -> StripMatches:
        """
        Match a live image (M, N) float32 of display values.

        With `near`, the `offset` (2,) that a frame before it had [px], that is not searched for.
        No exception when nothing matches: the pieces are few.
        """
        small = _reduced(live, self._factor)
        if near is None:
            corner = self._corner(small)
        else:
            corner = near / self._factor - self._shift_of(small.shape, np.zeros(2))
        table = self._tracked(small, corner)
        table[:, :4] *= self._factor
        offset = self._shift_of(small.shape, corner) * self._factor
        return StripMatches(table[:, :2], table[:, 2:4], table[:, 4:], offset)

    def _corner(self, small: np.ndarray) -> np.ndarray:
        """Corner x, y of the live frame in the reference (2,) [reduced px]."""
        if self._quick is not None:
            vote = self._quick.on(_reduced(small, 2))
            if vote.mean > SURE and vote.rival < ALONE:
                return 2.0 * vote.corner
        return self._votes.on(small).corner

    def _tracked(self, small: np.ndarray, corner: np.ndarray) -> np.ndarray:
        """
        Match bands of rows, each near where its neighbour lies: a frame may bend far.

        Starts at the band that matches best at the voted place and goes both ways. Returns X, Y,
        shift x, y and trust x, y of the n pieces that match, (n, 6) [reduced px].
        """
        height, width = max(8, small.shape[0] // STRIPS), small.shape[1] // PARTS
        tops = np.arange(0, small.shape[0] - height + 1, height)
        if not tops.size:  # a frame lower than a band
            return np.empty((0, 6))
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
        rows, columns = self._shape
        return corner + np.array([(shape[1] - columns) / 2.0, (shape[0] - rows) / 2.0])


def _reduced(image: np.ndarray, factor: int) -> np.ndarray:
    rows, cols = image.shape[0] // factor, image.shape[1] // factor
    whole = image[: rows * factor, : cols * factor]
    return cv2.resize(whole, (cols, rows), interpolation=cv2.INTER_AREA)


def sub_pixel_peak(scores: np.ndarray) -> tuple[float, ...] | None:
    """Place x, y, height and sharpness x, y of the highest correlation; None when too low."""
    found = np.empty(5)
    return tuple(found.tolist()) if highest(scores, MIN_PEAK, found) else None
