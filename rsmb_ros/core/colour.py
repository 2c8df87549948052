"""What changed in colour, where brightness alone does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ._kernels.evidence import surprise_of_tint
from .evidence import MAX_Z2, OUTLINE_WINDOW, NoiseTable, Texture, box_rms, misplaced
from .workers import Workers, each

WEIGHT = np.float32(0.5)  # of a deviation: cameras keep colours at half the size, and less exactly
WINDOW = 5  # px of the half-size image
SATURATED = np.float32(0.08)  # of a tint that may be lost next to its edges
GREY = 128  # tints without colour, as `cv2.cvtColor` has them
SOME = np.s_[::4, ::4]  # pixels that tell white balance and usual deviation
AROUND = np.ones((5, 5), np.uint8)  # px of the half-size image, which an edge may be mixed from
CLEAR = 6.0  # levels of tint; less is no other colour
CLEARLY = 2.5  # times what most of the frame is off


def _half(image: np.ndarray) -> Sequence[np.ndarray]:
    """Tints C_r, C_b of a BGR image (M, N, 3) uint8 at half its size, (M // 2, N // 2) uint8."""
    rows, cols = image.shape[:2]
    small = cv2.resize(image, (cols // 2, rows // 2), interpolation=cv2.INTER_AREA)
    return cv2.split(cv2.cvtColor(small, cv2.COLOR_BGR2YCrCb))[1:]


@dataclass(frozen=True)
class ColourEvidence:
    """How surprising the colours of a live frame are."""

    strength: np.ndarray  # (M, N) float32 [sigma], comparable to that of brightness
    squares: np.ndarray  # (M // 2, N // 2) float32, of the normalised residual, truncated
    limit: float  # levels that the tint of a place may be off and still be the same

    @cached_property
    def sharp(self) -> np.ndarray:
        """Evidence over a smaller window (M, N) float32 [sigma]."""
        return _over(OUTLINE_WINDOW, self.squares, self.strength.shape)

    @classmethod
    def of(
        cls,
        live: np.ndarray,
        predicted: np.ndarray,
        judged: np.ndarray,
        misfit: np.ndarray,
        place: np.ndarray,
        executor: Workers,
    ) -> ColourEvidence:
        """
        Compare a live frame with its prediction, both BGR (M, N, 3) uint8, at half their size.

        `judged` (M, N) bool, `misfit` (M, N) and `place` (M,) as in `NoiseTable.surprise`. Each
        tint is looked at by a thread.
        """
        rows, cols = judged.shape
        half = (cols // 2, rows // 2)
        valid = cv2.resize(judged.view(np.uint8), half, interpolation=cv2.INTER_NEAREST) > 0
        worse = cv2.resize(misfit, half, interpolation=cv2.INTER_NEAREST) / WEIGHT
        off = cv2.resize(place[:, None], (1, half[1]))[:, 0] / 2.0

        def surprise(pair: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, float]:
            return _surprise(*pair, valid, worse, off)

        tints = list(zip(_half(live), _half(predicted), strict=True))
        (squares, limit), *others = each(executor, surprise, tints)
        for more, own in others:
            np.maximum(squares, more, out=squares)
            limit = max(limit, own)
        return cls(_over(WINDOW, squares, judged.shape), squares, limit)


def _surprise(
    tint: np.ndarray, expected: np.ndarray, valid: np.ndarray, worse: np.ndarray, off: np.ndarray
) -> tuple[np.ndarray, float]:
    """
    Return how surprising a tint (M, N) uint8 is, z^2 (M, N), and its `ColourEvidence.limit`.

    `worse` (M, N) is what to multiply its noise by, `off` (M,) how far rows may be misplaced [px].
    """
    residual = cv2.subtract(tint, expected, dtype=cv2.CV_32F)
    some = residual[SOME][valid[SOME]]
    balance, limit = np.float32(0.0), CLEAR
    if some.size:
        balance = np.median(some)
        limit = max(limit, CLEARLY * float(np.percentile(np.abs(some - balance), 90)))
    texture = Texture.of(expected.astype(np.float32))
    noise = NoiseTable.learn(texture, residual - balance, valid)
    # near edges of rich colours a camera that keeps them at half the size is off by more
    rich = cv2.dilate(cv2.absdiff(expected, np.full_like(expected, GREY)), AROUND)
    squares = np.empty(valid.shape, np.float32)
    surprise_of_tint(
        residual, balance, worse, valid, texture.code, texture.energy, noise.variances,
        misplaced(texture, off), rich, SATURATED, MAX_Z2, squares,
    )  # fmt: skip
    return squares, limit


def _over(window: int, squares: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Root mean square over a window of an image at half size, float32 of `shape`."""
    return cv2.resize(box_rms(squares, window), shape[::-1], interpolation=cv2.INTER_LINEAR)


def tint_off(live: np.ndarray, predicted: np.ndarray, mask: np.ndarray) -> float:
    """Return by how many levels most of a mask (M, N) bool has another tint than predicted."""
    if not mask.any():
        return 0.0
    known, seen = (
        cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))[1:] for image in (predicted, live)
    )
    apart = (cv2.subtract(*pair, dtype=cv2.CV_32F) for pair in zip(seen, known, strict=True))
    off = [np.abs(cv2.blur(one, (WINDOW, WINDOW))[mask]) for one in apart]
    return float(np.median(np.maximum(*off)))
