"""Images from a known path."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS, homography, instant, instant_offset

BENT = 0.003  # px, largest error of places along a piece of a row


@njit(inline='always', **OPTIONS)
def half_place(h, a0, b0, c0, x, center):
    """Return where pixel `x` of a live row lies in the reference [half pixels]."""
    xc = x - center[0]
    w = 1.0 / (c0 + h[6] * xc)
    u = (a0 + 2.0 * h[0] * xc) * w + 2.0 * center[2]
    v = (b0 + 2.0 * h[3] * xc) * w + 2.0 * center[3]
    return u, v


@njit(**INLINED)
def pose_at(time, control, first_time, knot_rows, q):
    """Write the path coordinates at `time` into `q`."""
    instant(time, control, first_time, knot_rows, np.empty(4), q)


@njit(inline='always', **OPTIONS)
def cells(fraction, slope):
    """Return for how many steps of `slope` a `fraction` of a cell stays in its cell, at least 1."""
    if slope > 1e-9:
        return int(min((1.0 - fraction) / slope, 1e6)) + 1
    if slope < -1e-9:
        return int(min(-fraction / slope, 1e6)) + 1
    return 1000000


@njit(**INLINED)
def add_run(fine, at, stride, f_u, s_u, f_v, s_v, share, out, to, count):
    """
    Add `share` of the reference, read along a row from cell `at` on, to out[to:], both flat.

    Each step is two half pixels and changes the fractions by `s_u`, `s_v`: no index arithmetic,
    all loads in order. This loop is where rendering spends its time.
    """
    f_u = np.float32(f_u)
    f_v = np.float32(f_v)
    s_u = np.float32(s_u)
    s_v = np.float32(s_v)
    # unsigned: numba would check each signed index for wrapping around, and not vectorise
    at = np.uint64(at)
    to = np.uint64(to)
    below = at + np.uint64(stride)
    one = np.uint64(1)
    for k in range(np.uint64(count)):
        n = k + k
        step = np.float32(np.int32(k))
        u = f_u + step * s_u
        v = f_v + step * s_v
        left = fine[at + n]
        top = left + u * (fine[at + n + one] - left)
        left = fine[below + n]
        bottom = left + u * (fine[below + n + one] - left)
        out[to + k] += (top + v * (bottom - top)) * share


@njit(**OPTIONS)
def blur_rows(
    first, last, top, left, right, fine, half_rows, half_columns, times, samples, control,
    first_time, knot_rows, exposure, focal, center, inverse_depth, out, begins, ends,
):
    """
    Write the mean of the warped reference over each row's exposure (Eq. 1) for one layer.

    Rows first..last, columns left..right of the live frame; `out` begins at row `top` and column
    `left`. A row is complete in columns [begins, ends) and 0 outside.
    Places are taken linear over pieces so short that they are off by `BENT` px at most.
    """
    h = np.empty(9)
    q = np.zeros(6)
    half_width = center[0] + 0.5
    u_limit = half_columns - 2.0
    v_limit = half_rows - 2.0
    flat = out.reshape(-1)
    for i in range(first, last):
        count = samples[i]
        share = np.float32(1.0 / count)
        lo = left
        hi = right
        for x in range(right - left):
            out[i - top, x] = 0.0
        y = i - center[1]
        for k in range(count):
            pose_at(
                times[i] + instant_offset(k, count) * exposure, control, first_time, knot_rows, q
            )
            homography(q, focal, half_width, inverse_depth, h)
            a0 = 2.0 * (h[1] * y + h[2])
            b0 = 2.0 * (h[4] * y + h[5])
            c0 = h[7] * y + h[8]
            while lo < hi:
                u, v = half_place(h, a0, b0, c0, lo, center)
                if 0.0 <= u <= u_limit and 0.0 <= v <= v_limit:
                    break
                lo += 1
            while lo < hi:
                u, v = half_place(h, a0, b0, c0, hi - 1, center)
                if 0.0 <= u <= u_limit and 0.0 <= v <= v_limit:
                    break
                hi -= 1
            if lo >= hi:
                break
            bend = 2.0 * abs(h[6]) + 1e-12
            piece = max(2, int(min(math.sqrt(8.0 * BENT / bend), 1e5)))
            begin = lo
            u, v = half_place(h, a0, b0, c0, begin, center)
            while begin < hi:
                end = min(begin + piece, hi)
                u_end, v_end = half_place(h, a0, b0, c0, end, center)
                s_u = (u_end - u) / (end - begin) - 2.0
                s_v = (v_end - v) / (end - begin)
                x = begin
                while x < end:
                    u_x = u + (s_u + 2.0) * (x - begin)
                    v_x = v + s_v * (x - begin)
                    # the last sample of a row or column has no right neighbour: step back one
                    iu = max(0, min(int(u_x), half_columns - 2))
                    iv = max(0, min(int(v_x), half_rows - 2))
                    f_u = u_x - iu
                    f_v = v_x - iv
                    run = min(end - x, cells(f_u, s_u), cells(f_v, s_v))
                    # the run must end before its row of cells does
                    run = min(run, (half_columns - 2 - iu) // 2 + 1)
                    add_run(
                        fine, iv * half_columns + iu, half_columns, f_u, s_u, f_v, s_v, share,
                        flat, (i - top) * out.shape[1] + x - left, run,
                    )
                    x += run
                begin = end
                u = u_end
                v = v_end
        if lo >= hi:
            lo = left
            hi = left
        for x in range(lo - left):
            out[i - top, x] = 0.0
        for x in range(hi - left, right - left):
            out[i - top, x] = 0.0
        begins[i - top] = lo
        ends[i - top] = hi


@njit(**OPTIONS)
def live_places(first, last, inverses, center, rows, surface, shifts, map_x, map_y):
    """
    Write, for reference pixels of rows first..last, where the live frame shows them.

    `inverses` (M, 9) holds the inverse homography of each live row's centroid pose. The row is
    found by fixed-point iteration between whole rows; places may lie outside the frame. `surface`
    (M, N) is 1/d of the reference, None: 1 everywhere; `shifts` (M, 3) the inverses times the
    slope of the homographies over 1/d, `depth.parallax`.
    """
    for v in range(first, last):
        vc = v - center[3]
        y = vc + center[1]
        for u in range(map_x.shape[1]):
            uc = u - center[2]
            x = 0.0
            for _ in range(12):
                at = min(max(y, 0.0), rows - 1.000001)
                i = int(at)
                part = at - i
                g = inverses[i]
                n = inverses[i + 1]
                w = 1.0 / (g[6] * uc + g[7] * vc + g[8])
                w1 = 1.0 / (n[6] * uc + n[7] * vc + n[8])
                x0 = (g[0] * uc + g[1] * vc + g[2]) * w
                y0 = (g[3] * uc + g[4] * vc + g[5]) * w
                x1 = (n[0] * uc + n[1] * vc + n[2]) * w1
                y1 = (n[3] * uc + n[4] * vc + n[5]) * w1
                if surface is not None:
                    # (x, y, 1) = l G (u, v, 1) - e G s, with l such that the last is 1
                    excess = surface[v, u] - 1.0
                    x0 += excess * (shifts[i, 2] * x0 - shifts[i, 0])
                    y0 += excess * (shifts[i, 2] * y0 - shifts[i, 1])
                    x1 += excess * (shifts[i + 1, 2] * x1 - shifts[i + 1, 0])
                    y1 += excess * (shifts[i + 1, 2] * y1 - shifts[i + 1, 1])
                x = x0 + part * (x1 - x0)
                new = y0 + part * (y1 - y0) + center[1]
                done = abs(new - y) < 1e-3
                y = new
                if done:
                    break
            map_x[v, u] = x + center[0]
            map_y[v, u] = y
