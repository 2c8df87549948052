"""Where in the reference a whole live image lies: patches of it vote for one offset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .workers import Workers, each

PATCHES = 3  # per direction
FEW = 3.0  # patches that a place is counted as many more by, with no correlation
MIN_CONTRAST = 2.0  # grey levels; flatter patches say nothing
BESIDE = 5  # px around the elected place in which another is the same


@dataclass(frozen=True)
class Vote:
    """What most patches of an image agree on."""

    corner: np.ndarray  # (2,) x, y of the image's corner in the reference [px]
    mean: float  # correlation of the patches there, 0..1
    rival: float  # most votes of a place elsewhere over those there, 0..1


class GlobalVote:
    """
    Finds where most patches of live images lie in one reference.

    Parameters
    ----------
    reference : ndarray of shape (M, N), float32
        Display values.
    search_fraction : float
        How far from its middle place in the reference, or where it is the larger one from any
        place inside, an image may lie, of its own size.
    wobble : int
        How far rolling shutter may move a patch from where the image lies [px].
    executor : Workers
        Threads that share the patches.

    """

    def __init__(
        self, reference: np.ndarray, search_fraction: float, wobble: int, executor: Workers
    ) -> None:
        self._reference = reference
        self.textured = _local_contrast(reference)  # (M, N) float32, 0 where ground is flat
        self._fraction = search_fraction
        self._wobble = wobble
        self._near = np.ones((2 * wobble + 1,) * 2, np.uint8)
        self._executor = executor

    def on(self, image: np.ndarray) -> Vote:
        """Return where an image (m, n) float32 lies, the middle of all that are as good."""
        shape, reference = image.shape, self._reference.shape
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
            return tuple(max(corner[k] + low[k] - self._wobble, 0) for k in (0, 1))

        def end_of(corner: tuple[int, int]) -> tuple[int, ...]:
            return tuple(
                min(corner[k] + low[k] + size[k] - 1 + patch[k] + self._wobble, reference[k])
                for k in (0, 1)
            )

        def scores_of(corner: tuple[int, int]) -> np.ndarray | None:
            """Correlate a patch wherever it may lie, each place as good as the best near it."""
            row, col = corner
            begin, end = begin_of(corner), end_of(corner)
            piece = image[row : row + patch[0], col : col + patch[1]]
            beyond = any(end[k] - begin[k] < patch[k] for k in (0, 1))
            if beyond or not piece.size or _spread(piece) < MIN_CONTRAST:
                return None
            return cv2.dilate(self._correlate(piece, begin, end), self._near)

        found = each(self._executor, scores_of, corners)
        for corner, scores in zip(corners, found, strict=True):
            if scores is not None:
                at = [place - corner[k] - low[k] for k, place in enumerate(begin_of(corner))]
                _add_at(votes, counts, scores, at)
        return _elected(votes, counts, low)

    def _correlate(
        self, piece: np.ndarray, begin: tuple[int, ...], end: tuple[int, ...]
    ) -> np.ndarray:
        """Correlations 0..1 of `piece` at every place inside reference[begin:end] (row, col)."""
        window = np.s_[begin[0] : end[0], begin[1] : end[1]]
        scores = cv2.matchTemplate(self._reference[window], piece, cv2.TM_CCOEFF_NORMED)
        height, width = piece.shape
        textured = self.textured[window][
            height // 2 : height // 2 + scores.shape[0], width // 2 : width // 2 + scores.shape[1]
        ]
        np.fmin(np.fmax(scores, 0.0, out=scores), 1.0, out=scores)  # 0 where OpenCV has no number
        return np.multiply(scores, textured, out=scores)


def _local_contrast(image: np.ndarray) -> np.ndarray:
    """1 where the neighbourhood has contrast, else 0: correlation of flat ground is noise."""
    mean = cv2.blur(image, (9, 9))
    variance = cv2.blur(image * image, (9, 9)) - mean * mean
    seen = (variance > 1.0).astype(np.uint8)
    return cv2.dilate(seen, np.ones((9, 9), np.uint8)).astype(np.float32)


def _elected(votes: np.ndarray, counts: np.ndarray, low: Sequence[int]) -> Vote:
    """Return the place of most votes, of those of so many patches; the first is that at `low`."""
    # a place that only few patches can see must not win by luck: shrink means of few patches
    score = votes / (counts + FEW)
    most = float(score.max())
    # a patch moved by the wobble votes for all places around: the best ones lie side by side
    best = np.argwhere(score == most)
    row, col = best[0]
    count = float(counts[row, col])
    begin, end = np.maximum(best.min(axis=0) - BESIDE, 0), best.max(axis=0) + BESIDE + 1
    score[begin[0] : end[0], begin[1] : end[1]] = 0.0
    return Vote(
        corner=best.mean(axis=0)[::-1] + low[::-1],
        mean=float(votes[row, col]) / count if count else 0.0,
        rival=float(score.max()) / most if most else 1.0,
    )


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
