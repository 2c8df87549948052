"""What the pixels of one frame say, each alone."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS


@njit(**OPTIONS)
def mix_colours(colours, weights, grey):
    """Write the mixture of three colours, flat (3 n,) uint8, into `grey` (n,)."""
    w0 = weights[0]
    w1 = weights[1]
    w2 = weights[2]
    three = np.uint64(3)
    one = np.uint64(1)
    for k in range(np.uint64(grey.size)):
        n = three * k
        grey[k] = (
            w0 * np.float32(colours[n])
            + w1 * np.float32(colours[n + one])
            + w2 * np.float32(colours[n + one + one])
        )


@njit(**OPTIONS)
def mark_bright(image, channels, limit, residual, out):
    """Mark where a colour of an image is `limit` or more and `residual` (n,) below 0, all flat."""
    one = np.uint64(1)
    step = np.uint64(channels)
    for k in range(np.uint64(out.size)):
        n = step * k
        most = image[n]
        if channels == 3:
            most = max(most, max(image[n + one], image[n + one + one]))
        out[k] = (most >= limit) & (residual[k] < np.float32(0.0))


@njit(**INLINED)
def misfit_of(residual, judged, weighted):
    """Write |residual| where it is judged, else 0 (n,); return its sum and the judged pixels'."""
    for k in range(residual.size):
        weighted[k] = abs(residual[k]) if judged[k] else np.float32(0.0)
    # loops of their own: beside a store, sums add up in an order that depends on addresses
    total = np.float32(0.0)
    for k in range(residual.size):
        total += weighted[k]
    known = 0
    for k in range(residual.size):
        known += judged[k]
    return total, known


@njit(**OPTIONS)
def row_misfits(residual, judged, known, total):
    """Write each row's number of `judged` pixels and the sum of their |residual|."""
    weighted = np.empty(residual.shape[1], np.float32)
    for i in range(residual.shape[0]):
        total[i], known[i] = misfit_of(residual[i], judged[i], weighted)


@njit(**OPTIONS)
def some_gradients(image, asked, energies):
    """
    Write the squared gradient at every second pixel of every second row that is `asked`.

    `image` (M, N) float32, `asked` (M, N) bool. Returns how many of `energies` (n,) are written, in
    (units of the image / px)^2; the border is mirrored as OpenCV's Sobel does.
    """
    rows, columns = image.shape
    count = 0
    if rows < 2 or columns < 2:
        return count
    for y in range(0, rows, 2):
        above, row = image[abs(y - 1)], image[y]
        below = image[y + 1 if y + 1 < rows else rows - 2]
        for x in range(0, columns, 2):
            if asked[y, x]:
                a = abs(x - 1)
                b = x + 1 if x + 1 < columns else columns - 2
                right = above[b] + np.float32(2.0) * row[b] + below[b]
                left = above[a] + np.float32(2.0) * row[a] + below[a]
                down = below[a] + np.float32(2.0) * below[x] + below[b]
                up = above[a] + np.float32(2.0) * above[x] + above[b]
                energies[count] = ((right - left) ** 2 + (down - up) ** 2) * np.float32(1 / 64)
                count += 1
    return count


@njit(**INLINED)
def add_moments(one, other, known, count, sums):
    """Add a row's pixels, squares, product and `known` to column sums (6, n)."""
    for k in range(np.uint64(count)):
        a = one[k]
        b = other[k]
        sums[0, k] += a
        sums[1, k] += b
        sums[2, k] += a * a
        sums[3, k] += b * b
        sums[4, k] += a * b
        sums[5, k] += np.float32(known[k])


@njit(**OPTIONS)
def block_moments(one, other, known, size, means):
    """
    Write what agreement is worked out from: means over blocks of two images and of what is known.

    `means` (r, c, 6): of the blocks of `size` x `size` pixels from the corner on, the means of
    `one`, `other`, their squares, their product, and `known` (M, N) bool.
    """
    rows, columns, moments = means.shape
    sums = np.empty((moments, columns * size), np.float32)
    for i in range(rows):
        sums[:] = 0.0
        for y in range(i * size, (i + 1) * size):
            add_moments(one[y], other[y], known[y], columns * size, sums)
        for n in range(moments):
            for j in range(columns):
                total = 0.0
                for x in range(j * size, (j + 1) * size):
                    total += sums[n, x]
                means[i, j, n] = total / (size * size)
