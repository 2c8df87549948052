"""Normal equations of small shifts of single rows."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import OPTIONS

BAND = 4  # unknowns that one is coupled to: y of its row, and those of two rows on
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


@njit(**OPTIONS)
def median_size(residual, judged, step):
    """Return the median of |residual| (M, N) where `judged`, of every so many rows and columns."""
    rows, columns = residual.shape
    sizes = np.empty(-(-rows // step) * -(-columns // step), np.float32)
    count = 0
    for i in range(0, rows, step):
        for j in range(0, columns, step):
            if judged[i, j]:
                sizes[count] = abs(residual[i, j])
                count += 1
    return np.median(sizes[:count]) if count else np.float32(-1.0)


@njit(**OPTIONS)
def bend_little(sums, smooth, out):
    """
    Write shifts (M, 2) that solve the equations `sums` (M, TERMS) and `smooth` times their bend.

    The penalty is on second differences, and the least on sizes that keeps rows without data still.
    x and y of the rows take turns; the Cholesky factor of their band replaces it.
    """
    rows = sums.shape[0]
    size = 2 * rows
    band = np.zeros((size + BAND, BAND + 1))
    solution = np.zeros(size + BAND)
    for i in range(rows):
        # the squares of (1, -2, 1) at each row but the ends
        ends = min(i, rows - 1 - i)
        own = 1.0 if ends == 0 else (5.0 if ends == 1 else 6.0)
        beside = -2.0 if i == 0 or i == rows - 2 else -4.0
        for e in range(2):
            j = 2 * i + e
            band[j, 0] = np.float64(sums[i, 2 * e]) + smooth * (own + 1e-6)
            solution[j] = sums[i, 3 + e]
            if i + 1 < rows:
                band[j, 2] = smooth * beside
            if i + 2 < rows:
                band[j, 4] = smooth
        band[2 * i, 1] = sums[i, 1]
    for j in range(size):
        root = math.sqrt(band[j, 0])
        for d in range(BAND + 1):
            band[j, d] /= root
        solution[j] /= root
        for d in range(1, BAND + 1):
            for k in range(d, BAND + 1):
                band[j + d, k - d] -= band[j, d] * band[j, k]
            solution[j + d] -= band[j, d] * solution[j]
    for j in range(size - 1, -1, -1):
        for d in range(1, BAND + 1):
            solution[j] -= band[j, d] * solution[j + d]
        solution[j] /= band[j, 0]
        out[j // 2, j % 2] = solution[j]
