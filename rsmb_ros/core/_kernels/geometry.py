"""Camera pose at one instant and the line it maps a live row to."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

OPTIONS = {'cache': True, 'nogil': True, 'fastmath': True, 'error_model': 'numpy'}
# Of kernels that kernels call. Not inlined, they exist twice, compiled alone and in the caller, and
# which one runs depends on whether the caller was compiled or came from the cache; fastmath sums
# then differ in their last bits.
INLINED = {**OPTIONS, 'forceinline': True}
RUN_STEP = 4.0  # rows between instants at which the length of a path is taken
MOST_INSTANTS = 96  # of a row's exposure


@njit(inline='always', **OPTIONS)
def basis(u, out):
    """Write the four cubic B-spline weights at fraction `u` of a knot span."""
    v = 1.0 - u
    out[0] = v * v * v / 6.0
    out[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    out[2] = (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / 6.0
    out[3] = u * u * u / 6.0


@njit(inline='always', **OPTIONS)
def basis_slope(u, out):
    """Write the derivatives of the four weights with respect to `u`."""
    v = 1.0 - u
    out[0] = -0.5 * v * v
    out[1] = 1.5 * u * u - 2.0 * u
    out[2] = -1.5 * u * u + u + 0.5
    out[3] = 0.5 * u * u


@njit(inline='always', **OPTIONS)
def span(time, first_time, knot_rows, knots):
    """Return the span of `time` and the fraction in it; times beyond the ends are clamped."""
    s = (time - first_time) / knot_rows
    s = min(max(s, 0.0), knots - 3.000001)
    j = int(s)
    return j, s - j


@njit(inline='always', **OPTIONS)
def instant(time, control, first_time, knot_rows, b, q):
    """Write spline weights and path coordinates at `time`; return the span and the place in it."""
    j, fraction = span(time, first_time, knot_rows, control.shape[0])
    basis(fraction, b)
    for e in range(6):
        q[e] = (
            b[0] * control[j, e]
            + b[1] * control[j + 1, e]
            + b[2] * control[j + 2, e]
            + b[3] * control[j + 3, e]
        )
    return j, fraction


@njit(**INLINED)
def corner_runs(row_times, exposure, control, first_time, knot_rows, step, places, runs):
    """
    Write how far a corner of the frame moves during each row's exposure (M,) [px].

    A corner moves by the centre's motion plus what rotation, zoom and tilt add at its radius. The
    path is followed in steps of `step` rows; `places` (n,) is room for its length at them.
    """
    begin = -0.5 * exposure
    b = np.empty(4)
    last = np.empty(6)
    q = np.empty(6)
    instant(begin, control, first_time, knot_rows, b, last)
    places[0] = 0.0
    for n in range(1, places.size):
        instant(begin + n * step, control, first_time, knot_rows, b, q)
        turn = 0.0
        for e in range(2, 6):
            turn += abs(q[e] - last[e])
        places[n] = places[n - 1] + math.hypot(q[0] - last[0], q[1] - last[1]) + 0.7 * turn
        for e in range(6):
            last[e] = q[e]
    for r in range(row_times.size):
        at = (row_times[r] - 0.5 * exposure - begin) / step
        k = min(max(int(at), 0), places.size - 2)
        start = places[k] + (at - k) * (places[k + 1] - places[k])
        at = (row_times[r] + 0.5 * exposure - begin) / step
        k = min(max(int(at), 0), places.size - 2)
        runs[r] = places[k] + (at - k) * (places[k + 1] - places[k]) - start


@njit(inline='always', **OPTIONS)
def instant_offset(k, count):
    """
    Return where instant `k` of `count` >= 2 lies in an exposure, -0.5..0.5.

    Instants in the middles of equal parts, spread so that their variance is the exposure's: a mean
    over few of them then blurs as far as the integral does (two are those of Gauss-Legendre).
    """
    return ((k + 0.5) / count - 0.5) * count / math.sqrt(count * count - 1.0)


@njit(**INLINED)
def rotation(r_x, r_y, r_z, out):
    """Write R = exp([r]_x) [rad] as nine numbers, row by row (Rodrigues)."""
    angle2 = r_x * r_x + r_y * r_y + r_z * r_z
    if angle2 < 1e-14:
        a = 1.0
        b = 0.5
    else:
        angle = math.sqrt(angle2)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / angle2
    out[0] = 1.0 - b * (r_y * r_y + r_z * r_z)
    out[1] = b * r_x * r_y - a * r_z
    out[2] = b * r_x * r_z + a * r_y
    out[3] = b * r_x * r_y + a * r_z
    out[4] = 1.0 - b * (r_x * r_x + r_z * r_z)
    out[5] = b * r_y * r_z - a * r_x
    out[6] = b * r_x * r_z - a * r_y
    out[7] = b * r_y * r_z + a * r_x
    out[8] = 1.0 - b * (r_x * r_x + r_y * r_y)


@njit(**INLINED)
def homography(q, focal, half_width, inverse_depth, out):
    """
    Write H = R + T n^T / d between centred pixels, for path coordinates `q` (see `motion`).

    ``w (U, V, 1)^T = H (X, Y, 1)^T`` with (X, Y) from the live centre, (U, V) from the reference's.
    """
    tilt = focal / (half_width * half_width)
    rotation(
        -math.atan(q[5] * tilt), math.atan(q[4] * tilt), q[2] / half_width, out
    )
    zoom = half_width / (half_width + q[3])  # 1 / s
    t_x = q[0] * zoom / focal - out[2]
    t_y = q[1] * zoom / focal - out[5]
    t_z = zoom - out[8]
    out[2] = (out[2] + t_x * inverse_depth) * focal
    out[5] = (out[5] + t_y * inverse_depth) * focal
    out[6] /= focal
    out[7] /= focal
    out[8] += t_z * inverse_depth


@njit(**OPTIONS)
def homographies(qs, focal, half_width, inverse_depth, out):
    """Write the homographies (n, 9) of path coordinates `qs` (n, 6)."""
    for n in range(qs.shape[0]):
        homography(qs[n], focal, half_width, inverse_depth, out[n])


@njit(**OPTIONS)
def mean_coordinates(times, count, exposure, control, first_time, knot_rows, out):
    """Write the mean path coordinates over the exposure around each time: `count` equal parts."""
    b = np.empty(4)
    q = np.empty(6)
    for i in range(times.shape[0]):
        for e in range(6):
            out[i, e] = 0.0
        for k in range(count):
            time = times[i] + ((k + 0.5) / count - 0.5) * exposure
            instant(time, control, first_time, knot_rows, b, q)
            for e in range(6):
                out[i, e] += q[e] / count
