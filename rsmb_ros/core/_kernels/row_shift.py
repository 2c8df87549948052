"""Normal equations of small shifts of single rows."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import OPTIONS

TERMS = 6  # g_x^2, g_x g_y, g_y^2, g_x r, g_y r, misfit


@njit(**OPTIONS)
def row_sums(
    first, last, predicted, residual, judged, ends, variance, misplaced2, outlier2, sums
):
    """
    Write, per row and half of the columns, the weighted sums of `TERMS` into `sums` (M, 2, TERMS).

    Of rows first..last. The weight is Tukey's, 0 beyond sqrt(outlier2) sigma and where not
    `judged`, over the variance of a pixel: `variance` + misplaced2 |g|^2. The misfit is
    1 - (1 - z^2 / outlier2)^3. Stripes that end at the columns `ends` belong to the halves in turn;
    edge columns are left out.
    """
    rows, columns = predicted.shape
    terms = np.zeros((TERMS, columns), np.float32)
    halves = np.zeros((2, columns), np.float32)
    begin = 1
    for s in range(ends.size):
        halves[s % 2, begin : min(ends[s], columns - 1)] = 1.0
        begin = min(ends[s], columns - 1)
    for i in range(first, last):
        here = predicted[i]
        above = predicted[max(i - 1, 0)]
        below = predicted[min(i + 1, rows - 1)]
        for j in range(1, columns - 1):
            g_x = np.float32(0.5) * (here[j + 1] - here[j - 1])
            g_y = np.float32(0.5) * (below[j] - above[j])
            r = residual[i, j]
            own = variance + misplaced2 * (g_x * g_x + g_y * g_y)
            near = np.float32(1.0) - min(r * r / (outlier2 * own), np.float32(1.0))
            counts = np.float32(1.0) if judged[i, j] else np.float32(0.0)
            weight = counts * near * near / own
            terms[0, j] = weight * g_x * g_x
            terms[1, j] = weight * g_x * g_y
            terms[2, j] = weight * g_y * g_y
            terms[3, j] = weight * g_x * r
            terms[4, j] = weight * g_y * r
            terms[5, j] = counts * (np.float32(1.0) - near * near * near)
        # loops of their own: beside a store, sums add up in an order that depends on addresses
        for n in range(TERMS):
            one = np.float32(0.0)
            other = np.float32(0.0)
            for j in range(columns):
                one += terms[n, j] * halves[0, j]
                other += terms[n, j] * halves[1, j]
            sums[i, 0, n] = one
            sums[i, 1, n] = other
