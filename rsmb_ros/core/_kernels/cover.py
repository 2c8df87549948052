"""Where static objects hide the ground: their masks on the reference, and during an exposure."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS, homography
from .render import cells, half_place, pose_at

BENT = 0.05  # px, largest error of places along a piece of a row


@njit(**OPTIONS)
def draw_masks(masks, x_first, y_first, homographies, center, left, top, out):
    """
    Set out[n] to 1 at the reference pixels that masks[n] (rows, cols) covers in the live frame.

    The masks begin at live column `x_first` and row `y_first`, whose rows are mapped by
    `homographies` (rows, 9); `out` at reference column `left` and row `top`. What lies beyond it
    is dropped.
    """
    for row in range(masks.shape[1]):
        h = homographies[row]
        y = y_first + row - center[1]
        a0 = 2.0 * (h[1] * y + h[2])
        b0 = 2.0 * (h[4] * y + h[5])
        c0 = h[7] * y + h[8]
        for col in range(masks.shape[2]):
            if not (masks[0, row, col] or masks[1, row, col]):
                continue
            u, v = half_place(h, a0, b0, c0, x_first + col, center)
            i = math.floor(0.5 * v + 0.5) - top
            j = math.floor(0.5 * u + 0.5) - left
            if i < 0 or j < 0 or i >= out.shape[1] or j >= out.shape[2]:
                continue
            for n in range(masks.shape[0]):
                if masks[n, row, col]:
                    out[n, i, j] = 1


@njit(**INLINED)
def widen_range(cover, at, lowest, highest, to, count):
    """Take cover[at:] into the least and greatest of [to:]: all flat, bytes, loads in order."""
    at = np.uint64(at)
    to = np.uint64(to)
    for k in range(np.uint64(count)):
        seen = cover[at + k]
        low = lowest[to + k]
        high = highest[to + k]
        lowest[to + k] = seen if seen < low else low
        highest[to + k] = seen if seen > high else high


@njit(**INLINED)
def clear(out, to, count):
    """Set `count` bytes of out[to:] to 0."""
    to = np.uint64(to)
    for k in range(np.uint64(count)):
        out[to + k] = 0


@njit(**OPTIONS)
def watch_cover(
    top, left, cover, cover_left, cover_top, times, samples, control, first_time, knot_rows,
    duration, focal, center, inverse_depth, shift, lowest, highest,
):
    """
    Write the least and the greatest value of `cover` that each pixel sees.

    It is asked at `samples` >= 2 instants of each row, evenly from the first to the last of the
    `duration` around the middle of its exposure.

    `lowest` and `highest` (rows, cols) uint8 begin at live row `top` and column `left`, `cover`
    uint8 at row `cover_top` and column `cover_left` of the reference; it is 0 beyond its ends. A
    value of it holds up to the next row and column. Its layer is moved by `shift` x, y [px].
    """
    h = np.empty(9)
    q = np.zeros(6)
    half_width = center[0] + 0.5
    rows, columns = cover.shape
    right = left + lowest.shape[1]
    values = cover.reshape(-1)
    low = lowest.reshape(-1)
    high = highest.reshape(-1)
    for row in range(lowest.shape[0]):
        for x in range(lowest.shape[1]):
            lowest[row, x] = 255
            highest[row, x] = 0
        y = top + row - center[1]
        to = row * lowest.shape[1] - left
        count = samples[top + row]
        for k in range(count):
            time = times[top + row] + (k / (count - 1.0) - 0.5) * duration
            pose_at(time, control, first_time, knot_rows, q)
            q[0] += shift[0] / inverse_depth
            q[1] += shift[1] / inverse_depth
            homography(q, focal, half_width, inverse_depth, h)
            a0 = 2.0 * (h[1] * y + h[2])
            b0 = 2.0 * (h[4] * y + h[5])
            c0 = h[7] * y + h[8]
            piece = max(2, int(min(math.sqrt(8.0 * BENT / (2.0 * abs(h[6]) + 1e-12)), 1e5)))
            begin = left
            u, v = half_place(h, a0, b0, c0, begin, center)
            while begin < right:
                end = min(begin + piece, right)
                u_end, v_end = half_place(h, a0, b0, c0, end, center)
                s_u = 0.5 * (u_end - u) / (end - begin)
                s_v = 0.5 * (v_end - v) / (end - begin)
                x = begin
                while x < end:
                    u_x = 0.5 * u + s_u * (x - begin) - cover_left
                    v_x = 0.5 * v + s_v * (x - begin) - cover_top
                    i = math.floor(v_x)
                    j = math.floor(u_x)
                    in_cell = min(cells(u_x - j, s_u - 1.0), cells(v_x - i, s_v), 1e6)
                    run = min(end - x, int(in_cell) + 1)
                    before = run if i < 0 or i >= rows else min(run, max(0, -j))
                    inside = max(0, min(run, columns - j) - before)
                    clear(low, to + x, before)
                    if inside > 0:
                        widen_range(
                            values, i * columns + j + before, low, high, to + x + before, inside
                        )
                    clear(low, to + x + before + inside, run - before - inside)
                    x += run
                begin = end
                u = u_end
                v = v_end
