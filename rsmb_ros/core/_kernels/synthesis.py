"""
Forward model: planes seen through a path, as cubic splines, unlike the estimator's own sampling.

Between the pixels of an image taken by a camera a cubic spline is wrong by two thirds of what Keys'
bicubic interpolation is: what is judged by these images must not be better than they are.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# No fastmath: equal seeds must give equal bytes, however the sums are vectorised.
EXACT = {'cache': True, 'nogil': True, 'error_model': 'numpy'}
STATIC, NEW, GONE = 0, 1, 2  # in both images, in the live one only, in the reference only


@njit(inline='always', **EXACT)
def weights(t, spline, keys):
    """Write the four weights at fraction `t`: cubic B-spline, and Keys (a = -1/2)."""
    s = 1.0 - t
    spline[0] = s * s * s / 6.0
    spline[1] = ((3.0 * t - 6.0) * t * t + 4.0) / 6.0
    spline[2] = ((3.0 * s - 6.0) * s * s + 4.0) / 6.0
    spline[3] = t * t * t / 6.0
    keys[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    keys[1] = (1.5 * t - 2.5) * t * t + 1.0
    keys[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    keys[3] = (0.5 * t - 0.5) * t * t


@njit(**EXACT)
def sample(flat, start, rows, cols, channels, u, v, w_x, w_y, out):
    """
    Write the value of an image inside `flat` at column u, row v; outside the edge goes on.

    The first channels are coefficients of a cubic B-spline, mirrored at the edges; the last, alpha,
    is pixels (Keys), for a spline would surround an outline with ripples. `w_x`, `w_y`: (2, 4).
    """
    u = min(max(u, 0.0), cols - 1.0)
    v = min(max(v, 0.0), rows - 1.0)
    j = min(int(u), cols - 2)
    i = min(int(v), rows - 2)
    weights(u - j, w_x[0], w_x[1])
    weights(v - i, w_y[0], w_y[1])
    for c in range(channels):
        out[c] = 0.0
    alpha = channels - 1
    for m in range(4):
        line = abs(i + m - 1)
        if line >= rows:
            line = 2 * rows - 2 - line
        line = start + line * cols * channels
        for n in range(4):
            at = abs(j + n - 1)
            if at >= cols:
                at = 2 * cols - 2 - at
            at = line + at * channels
            weight = w_y[0, m] * w_x[0, n]
            for c in range(alpha):
                out[c] += weight * flat[at + c]
            out[alpha] += w_y[1, m] * w_x[1, n] * flat[at + alpha]


@njit(inline='always', **EXACT)
def distorted(x, y, k):
    """Sensor place of the ideal place (x, y), in half widths: inverse of p (1 + k |p|^2)."""
    u = x
    v = y
    for _ in range(4):
        s = 1.0 / (1.0 + k * (u * u + v * v))
        u = x * s
        v = y * s
    return u, v


@njit(**EXACT)
def expose_rows(
    first, last, flat, starts, shapes, corners, kinds, hs, counts, begins, center, half_width,
    distortion, channels, live, clean, cover, place, outside,
):
    """
    Write rows first..last-1 of Eq. 2 and 5: the mean over each row's instants of all planes.

    Plane 0 is the ground, the others lie in front of it in order; each is rows x cols x (channels +
    alpha) in `flat`, see `sample`. `hs` (instants, planes, 9). `cover` (planes, M, N): share of
    the exposure a plane is seen, `place` (M, N, 2) the mean ground place, `outside` (M, N) the
    share of the exposure beyond the reference.
    """
    planes = starts.shape[0]
    cols = live.shape[1]
    w_x = np.empty((2, 4))
    w_y = np.empty((2, 4))
    seen = np.empty(channels + 1)
    now = np.empty(channels)
    before = np.empty(channels)
    share = np.empty(planes)
    right = 2.0 * center[2]
    bottom = 2.0 * center[3]
    for row in range(first, last):
        part = 1.0 / counts[row]
        for x in range(cols):
            xc = x - center[0]
            yc = row - center[1]
            stretch = 1.0 + distortion * (xc * xc + yc * yc) / (half_width * half_width)
            xc *= stretch
            yc *= stretch
            for k in range(begins[row], begins[row] + counts[row]):
                for n in range(planes):
                    w = 1.0 / (hs[k, n, 6] * xc + hs[k, n, 7] * yc + hs[k, n, 8])
                    u = (hs[k, n, 0] * xc + hs[k, n, 1] * yc + hs[k, n, 2]) * w
                    v = (hs[k, n, 3] * xc + hs[k, n, 4] * yc + hs[k, n, 5]) * w
                    if n == 0:
                        a, b = distorted(u / half_width, v / half_width, distortion)
                        a = a * half_width + center[2]
                        b = b * half_width + center[3]
                        place[row, x, 0] += part * a
                        place[row, x, 1] += part * b
                        if a < 0.0 or b < 0.0 or a > right or b > bottom:
                            outside[row, x] += part
                    u += center[2] + corners[n, 0]
                    v += center[3] + corners[n, 1]
                    rows_n = shapes[n, 0]
                    cols_n = shapes[n, 1]
                    if n == 0:
                        sample(flat, starts[n], rows_n, cols_n, channels + 1, u, v, w_x, w_y, seen)
                        for c in range(channels):
                            now[c] = seen[c]
                            before[c] = seen[c]
                        share[0] = 1.0
                        continue
                    share[n] = 0.0
                    if u <= 0.0 or v <= 0.0 or u >= cols_n - 1.0 or v >= rows_n - 1.0:
                        continue
                    sample(flat, starts[n], rows_n, cols_n, channels + 1, u, v, w_x, w_y, seen)
                    alpha = min(max(seen[channels], 0.0), 1.0)
                    if alpha == 0.0:
                        continue
                    share[n] = alpha
                    if kinds[n] == STATIC:
                        for m in range(n):
                            share[m] *= 1.0 - alpha
                    if kinds[n] != GONE:
                        for c in range(channels):
                            now[c] += alpha * (seen[c] - now[c])
                    if kinds[n] != NEW:
                        for c in range(channels):
                            before[c] += alpha * (seen[c] - before[c])
                for c in range(channels):
                    live[row, x, c] += part * now[c]
                    clean[row, x, c] += part * before[c]
                for n in range(planes):
                    cover[n, row, x] += part * share[n]
