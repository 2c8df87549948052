"""Images from a known path."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import OPTIONS, basis, homography, span


@njit(**OPTIONS)
def pose_at(time, control, first_time, knot_rows, q):
    """Write the path coordinates at `time` into `q`."""
    b = np.empty(4)
    j, fraction = span(time, first_time, knot_rows, control.shape[0])
    basis(fraction, b)
    for e in range(6):
        q[e] = (
            b[0] * control[j, e]
            + b[1] * control[j + 1, e]
            + b[2] * control[j + 2, e]
            + b[3] * control[j + 3, e]
        )


@njit(**OPTIONS)
def blur_rows(
    first, last, left, right, fine, half_rows, half_columns, times, samples, control, first_time,
    knot_rows, exposure, focal, center, inverse_depth, out, begins, ends,
):
    """
    Write the mean of the warped reference over each row's exposure (Eq. 1) for one layer.

    Rows first..last, columns left..right of `out`; a row is complete in [begins, ends), 0 outside.
    """
    h = np.empty(9)
    q = np.zeros(6)
    half_width = center[0] + 0.5
    u_limit = half_columns - 2.0
    v_limit = half_rows - 2.0
    for i in range(first, last):
        count = samples[i]
        share = np.float32(1.0 / count)
        lo = left
        hi = right
        for x in range(left, right):
            out[i, x] = 0.0
        y = i - center[1]
        for k in range(count):
            pose_at(
                times[i] + ((k + 0.5) / count - 0.5) * exposure, control, first_time, knot_rows, q
            )
            homography(q, focal, half_width, inverse_depth, h)
            a0 = h[1] * y + h[2]
            b0 = h[4] * y + h[5]
            c0 = h[7] * y + h[8]
            run_lo = right
            run_hi = left
            for x in range(lo, hi):
                xc = x - center[0]
                w = 1.0 / (c0 + h[6] * xc)
                u = 2.0 * ((a0 + h[0] * xc) * w + center[2])
                v = 2.0 * ((b0 + h[3] * xc) * w + center[3])
                if u < 0.0 or v < 0.0 or u > u_limit or v > v_limit:
                    continue
                run_lo = min(run_lo, x)
                run_hi = x + 1
                iv = int(v)
                iu = int(u)
                # the last sample of a row or column has no right neighbour: step back one
                iv = min(iv, half_rows - 2)
                iu = min(iu, half_columns - 2)
                f_u = np.float32(u - iu)
                f_v = np.float32(v - iv)
                at = iv * half_columns + iu
                f00 = fine[at]
                f10 = fine[at + half_columns]
                top = f00 + f_u * (fine[at + 1] - f00)
                bottom = f10 + f_u * (fine[at + half_columns + 1] - f10)
                out[i, x] += (top + f_v * (bottom - top)) * share
            lo = max(lo, run_lo)
            hi = min(hi, run_hi)
            if lo >= hi:
                break
        if lo >= hi:
            lo = left
            hi = left
        for x in range(left, lo):
            out[i, x] = 0.0
        for x in range(hi, right):
            out[i, x] = 0.0
        begins[i] = lo
        ends[i] = hi


@njit(**OPTIONS)
def live_places(first, last, inverses, center, rows, map_x, map_y):
    """
    Write, for reference pixels of rows first..last, where the live frame shows them.

    `inverses` (M, 9) holds the inverse homography of each live row's centroid pose. The row is
    found by fixed-point iteration between whole rows; places may lie outside the frame.
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
                x = x0 + part * ((n[0] * uc + n[1] * vc + n[2]) * w1 - x0)
                new = y0 + part * ((n[3] * uc + n[4] * vc + n[5]) * w1 - y0) + center[1]
                done = abs(new - y) < 1e-3
                y = new
                if done:
                    break
            map_x[v, u] = x + center[0]
            map_y[v, u] = y
