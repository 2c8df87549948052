"""How large residuals are against the noise that intensity and texture let expect."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

TEXTURE_STEP = 0.125  # grey levels / px, resolution of the texture in codes
TEXTURE_REACH = 2  # px; a pixel's texture is the mean of 5 x 5


@njit(inline='always', **OPTIONS)
def mirrored(n, size):
    """Return the line that continues an image of `size` lines at `n`; the edge is not repeated."""
    n = abs(n)
    if n >= size:
        n = 2 * size - 2 - n
    return max(0, min(n, size - 1))


@njit(**INLINED)
def gradient_row(above, here, below, out):
    """Write the squared gradient (Sobel, per px) of a row between its neighbours, (n,)."""
    size = here.size
    one = np.uint64(1)
    scale = np.float32(1.0 / 64.0)
    two = np.float32(2.0)
    for x in range(one, np.uint64(size - 1)):
        left = above[x - one] + two * here[x - one] + below[x - one]
        right = above[x + one] + two * here[x + one] + below[x + one]
        g_x = right - left
        g_y = (
            below[x - one] - above[x - one] + two * (below[x] - above[x])
            + below[x + one] - above[x + one]
        )  # fmt: skip
        out[x] = (g_x * g_x + g_y * g_y) * scale
    for x in (0, size - 1):
        inner = mirrored(x + 1 if x == 0 else x - 1, size)
        g_y = two * (below[inner] - above[inner] + below[x] - above[x])
        out[x] = g_y * g_y * scale


@njit(**INLINED)
def sum_mirrored(row, reach, first, last, out):
    """Write the sums of 2 `reach` + 1 neighbours for out[first:last], mirrored at the ends."""
    for x in range(first, last):
        out[x] = 0.0
        for k in range(-reach, reach + 1):
            out[x] += row[mirrored(x + k, row.size)]


@njit(**INLINED)
def sum_along(row, reach, out):
    """Write the sums of 2 `reach` + 1 neighbours along a row, (n,)."""
    size = row.size
    first = min(reach, size)
    last = max(size - reach, first)
    sum_mirrored(row, reach, 0, first, out)
    sum_mirrored(row, reach, last, size, out)
    begin = np.uint64(first)
    end = np.uint64(last)
    one = np.uint64(1)
    two = np.uint64(2)
    three = np.uint64(3)
    # the windows in use, each in one pass: five times as fast as a pass for each neighbour
    if reach == 1:
        for x in range(begin, end):
            out[x] = row[x] + (row[x - one] + row[x + one])
    elif reach == 2:
        for x in range(begin, end):
            out[x] = row[x] + (row[x - one] + row[x + one]) + (row[x - two] + row[x + two])
    elif reach == 3:
        for x in range(begin, end):
            near = row[x] + (row[x - one] + row[x + one]) + (row[x - two] + row[x + two])
            out[x] = near + (row[x - three] + row[x + three])
    else:
        sum_mirrored(row, reach, first, last, out)


@njit(**OPTIONS)
def describe_rows(first, last, image, energy, code):
    """
    Write the squared gradient of an image (M, N) and the codes of intensity and texture, uint16.

    A code is 256 times the grey level plus the texture, the rms gradient over 5 x 5 px, in steps.
    """
    rows, columns = image.shape
    ring = np.empty((5, columns), np.float32)
    outside = np.empty(columns, np.float32)
    scale = np.float32(1.0 / (25.0 * TEXTURE_STEP * TEXTURE_STEP))
    top = np.float32(255.0)
    for y in range(max(0, first - TEXTURE_REACH), min(rows, last + TEXTURE_REACH)):
        row = energy[y] if first <= y < last else outside
        gradient_row(image[mirrored(y - 1, rows)], image[y], image[mirrored(y + 1, rows)], row)
        sum_along(row, TEXTURE_REACH, ring[y % 5])
        # the row in the middle of the ring is complete now, at the bottom of the image three are
        ready = y - TEXTURE_REACH
        until = ready + 1 if y < rows - 1 else rows
        for i in range(max(ready, first), min(until, last)):
            a = ring[mirrored(i - 2, rows) % 5]
            b = ring[mirrored(i - 1, rows) % 5]
            c = ring[i % 5]
            d = ring[mirrored(i + 1, rows) % 5]
            e = ring[mirrored(i + 2, rows) % 5]
            grey = image[i]
            out = code[i]
            for x in range(columns):
                mean = (a[x] + b[x] + c[x] + d[x] + e[x]) * scale
                step = np.int32(min(np.float32(math.sqrt(mean)), top))
                level = np.int32(min(max(grey[x], np.float32(0.0)), top))
                out[x] = level * 256 + step


@njit(**OPTIONS)
def count_codes(code, valid, levels, steps):
    """Count how often every second pixel of every second row has each level and step (256,)."""
    two = np.uint64(2)
    for y in range(0, code.shape[0], 2):
        codes = code[y]
        asked = valid[y]
        for k in range(np.uint64((codes.size + 1) // 2)):
            n = codes[two * k]
            once = np.int64(asked[two * k])
            levels[n >> 8] += once
            steps[n & 255] += once


@njit(**OPTIONS)
def count_residuals(code, residual, valid, level_bin, step_bin, resolution, counts):
    """
    Count the absolute residuals of the same pixels in each bin, counts (bins, 256).

    `resolution` is per grey level; a code's bin is level_bin + step_bin.
    """
    scale = np.float32(resolution)
    most = np.float32(255.0)
    two = np.uint64(2)
    flat = counts.reshape(-1)
    for y in range(0, code.shape[0], 2):
        codes = code[y]
        off = residual[y]
        asked = valid[y]
        for k in range(np.uint64((codes.size + 1) // 2)):
            x = two * k
            if asked[x]:
                n = codes[x]
                height = np.int32(min(abs(off[x]) * scale, most))
                own = level_bin[n >> 8] + step_bin[n & 255]
                flat[np.uint64(256 * own + height)] += 1


@njit(**OPTIONS)
def fill_variances(sigma, level_place, step_place, out):
    """
    Write the squared bilinear interpolation of a table at the places of each code (65536,).

    Places do not decrease.
    """
    rows, columns = sigma.shape
    along = np.empty(columns, np.float32)
    for level in range(256):
        i = min(int(level_place[level]), rows - 2)
        part = level_place[level] - np.float32(i)
        for j in range(columns):
            along[j] = sigma[i, j] + part * (sigma[i + 1, j] - sigma[i, j])
        own = out[256 * level : 256 * (level + 1)]
        begin = 0
        for j in range(columns - 1):
            # steps between the same two columns, together
            end = begin
            while end < 256 and (j == columns - 2 or step_place[end] < j + 1):
                end += 1
            rise = along[j + 1] - along[j]
            for step in range(np.uint64(begin), np.uint64(end)):
                value = along[j] + (step_place[step] - np.float32(j)) * rise
                own[step] = value * value
            begin = end


@njit(**INLINED)
def look_up(code, variances, out):
    """Write the variances of codes (n,): apart, what is done with them is vectorised."""
    for x in range(np.uint64(code.size)):
        out[x] = variances[code[x]]


@njit(**OPTIONS)
def surprise_rows(
    first, last, residual, misfit, judged, code, energy, variances, misplaced, most, out,
):
    """
    Write min(z^2, most) of the pixels that are judged, 0 elsewhere; z is residual over noise.

    `misplaced` (M,) is the variance of each row's place [px^2].
    """
    top = np.float32(most)
    noise = np.empty(residual.shape[1], np.float32)
    for y in range(first, last):
        place = misplaced[y]
        look_up(code[y], variances, noise)
        for x in range(np.uint64(noise.size)):
            scale = misfit[y, x]
            variance = (noise[x] + place * energy[y, x]) * scale * scale
            z2 = min(residual[y, x] * residual[y, x] / variance, top)
            out[y, x] = z2 if judged[y, x] else np.float32(0.0)


@njit(**OPTIONS)
def surprise_of_tint(
    residual, balance, misfit, judged, code, energy, variances, misplaced, colour, share, most, out,
):
    """
    Write min(z^2, most) of a tint's `residual` (M, N) where it is judged, else 0.

    `balance` is what all residuals are off by; `colour` (M, N) uint8 is how rich the colours
    around a pixel are, of which a `share` may be lost.
    """
    top = np.float32(most)
    noise = np.empty(residual.shape[1], np.float32)
    for y in range(residual.shape[0]):
        place = misplaced[y]
        look_up(code[y], variances, noise)
        for x in range(np.uint64(noise.size)):
            scale = misfit[y, x]
            lost = share * np.float32(colour[y, x])
            variance = (noise[x] + place * energy[y, x] + lost * lost) * scale * scale
            off = residual[y, x] - balance
            z2 = min(off * off / variance, top)
            out[y, x] = z2 if judged[y, x] else np.float32(0.0)


@njit(**OPTIONS)
def box_rms_rows(first, last, image, reach, out):
    """Write the root of the mean of an image (M, N) over 2 `reach` + 1 pixels to each side."""
    rows, columns = image.shape
    total = np.empty(columns, np.float32)
    scale = np.float32(1.0 / (2 * reach + 1) ** 2)
    for y in range(first, last):
        total[:] = image[mirrored(y - reach, rows)]
        for k in range(1 - reach, reach + 1, 2):
            line = image[mirrored(y + k, rows)]
            after = image[mirrored(y + k + 1, rows)]
            for x in range(columns):
                total[x] = total[x] + line[x] + after[x]
        row = out[y]
        sum_along(total, reach, row)
        for x in range(columns):
            row[x] = math.sqrt(row[x] * scale)
