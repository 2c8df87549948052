"""
Whether single rows of a live frame lie elsewhere than its path says, and where.

A shift that a row only needs to fit its own noise does not fit other columns of the same row. So
columns are dealt to two halves in stripes, and what one half asks for is measured on the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ._kernels.iterate import MIN_SIGMA
from ._kernels.row_shift import TERMS, bend_little, median_size, row_sums
from .workers import Workers, shared

STRIPES = 20  # over the width; every other one belongs to the second half
SMOOTH = 1e4  # 1/px^2, weight of bends: a row may bend its neighbours' line by 0.01 px (sigma)
OUTLIER = 5.0  # sigma, beyond which a pixel says nothing
MISPLACED = 0.1  # px, by which an edge may be off for reasons that are not the camera
SOME = 4  # every so many rows and columns tell the noise of all


@dataclass(frozen=True)
class RowSignal:
    """What the rows of a frame say that its path does not."""

    share: float  # of the misfit of each half of the columns, explained by the other half's shifts
    sums: np.ndarray  # (M, TERMS) normal equations of the rows' shifts by all columns

    @cached_property
    def shift(self) -> np.ndarray:
        """Shifts x, y of the rows by all columns (M, 2) [px of the live frame]."""
        return smooth_shifts(self.sums)


def row_signal(
    predicted: np.ndarray, residual: np.ndarray, judged: np.ndarray, executor: Workers
) -> RowSignal:
    """
    Measure how far rows lie from where they are predicted, and whether that can be believed.

    Parameters
    ----------
    predicted, residual : ndarray of shape (M, N), float32
        Prediction and live - predicted [grey levels].
    judged : ndarray of shape (M, N), bool
        Pixels that count.
    executor : Workers
        Threads that share the rows.

    """
    rows, columns = judged.shape
    median = median_size(residual, judged, SOME)
    if median < 0.0:
        return RowSignal(0.0, np.zeros((rows, TERMS), np.float32))
    sigma = max(MIN_SIGMA, 1.4826 * median)
    ends = -(-columns * np.arange(1, STRIPES + 1) // STRIPES)
    sums = np.empty((rows, 2, TERMS), np.float32)

    def run(first: int, last: int) -> None:
        row_sums(
            first, last, predicted, residual, judged, ends, np.float32(sigma**2),
            np.float32(MISPLACED**2), np.float32(OUTLIER**2), sums,
        )  # fmt: skip

    shared(executor, run, rows, judged.size)
    halves = [smooth_shifts(sums[:, n]) for n in (0, 1)]
    explained = sum(_explained(sums[:, 1 - n], shift) for n, shift in enumerate(halves))
    misfit = OUTLIER**2 / 6 * float(sums[:, :, 5].sum())
    return RowSignal(explained / max(misfit, 1e-6), sums.sum(axis=1))


def second_half(columns: np.ndarray, width: int) -> np.ndarray:
    """Whether `columns` of an image `width` px wide belong to the second half, bool."""
    return columns * STRIPES // width % 2 == 1


def smooth_shifts(sums: np.ndarray) -> np.ndarray:
    """Shifts (M, 2) [px] that solve the normal equations `sums` (M, TERMS) and bend little."""
    shifts = np.empty((len(sums), 2))
    bend_little(sums, SMOOTH, shifts)
    return shifts


def _explained(sums: np.ndarray, shift: np.ndarray) -> float:
    """Misfit that shifts (M, 2) take away by normal equations (M, TERMS); below 0: they add."""
    xx, xy, yy, r_x, r_y = sums[:, :5].T
    x, y = shift.T
    return float((r_x * x + r_y * y - 0.5 * (xx * x * x + 2 * xy * x * y + yy * y * y)).sum())
