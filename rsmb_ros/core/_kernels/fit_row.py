"""One row of points in the path fit: where it lies, what it shows, what it says."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

EXTRA = 7  # unknowns after the control points: four gain coefficients, bias, exposure, defocus
# Rows of a Jacobian before those of the control points: the extras and one of zeros, since sums are
# made four by four.
AHEAD = 8
EXPOSED, BLURRED = 5, 6  # which of the extras are exposure and defocus
SPARE = 4  # rows of zeros after those of the control points
BIAS_SCALE = np.float32(10.0)  # grey levels per unit of the bias unknown
TONES = np.float32(32.0)  # entries of a tone table per unit of the root of linear light
BRIGHTEST = np.float32(1020.0)  # linear light at the end of a tone table, four times white
DARKEST = np.float32(0.25)  # linear light that the tone curve starts at


@njit(**OPTIONS)
def strongest_gradients(image, rows, columns, values):
    """Write, per row and bin of it, the column of the largest |dx| + |dy| and the value there."""
    height, width = image.shape
    bins = columns.shape[1]
    for r in range(rows.size):
        y = rows[r]
        above = max(y - 1, 0)
        below = min(y + 1, height - 1)
        for b in range(bins):
            best = np.float32(-1.0)
            begin = max(1, b * width // bins)
            best_x = begin
            for x in range(begin, min(width - 1, (b + 1) * width // bins)):
                strength = abs(image[y, x + 1] - image[y, x - 1]) + abs(
                    image[below, x] - image[above, x]
                )
                if strength > best:
                    best = strength
                    best_x = x
            columns[r, b] = best_x
            values[r, b] = image[y, best_x]


@njit(**INLINED)
def place_row(
    half_rows, half_columns, x, h, y, level, center, at, f_u, f_v, inside, inverse_depth, r,
    nearer,
):
    """
    Find where one instant puts the points of one row in the half-pixel reference.

    `x`, `y` are live places from the centre [px]. Writes the cell and the fractions in it. Points
    lie at `inverse_depth[r]`, see `depth.parallax`; None: all at 1, and compiled without.
    """
    scale = 2.0 / level
    # float32 holds a place of 4096 half pixels to 0.0005
    c0 = np.float32(h[7] * y + h[8])
    c1 = np.float32(h[6])
    a0 = np.float32((h[1] * y + h[2]) * scale)
    a1 = np.float32(h[0] * scale)
    b0 = np.float32((h[4] * y + h[5]) * scale)
    b1 = np.float32(h[3] * scale)
    u_0 = np.float32(center[2] * scale + 1.0 / level - 1.0)
    v_0 = np.float32(center[3] * scale + 1.0 / level - 1.0)
    u_limit = np.float32(half_columns - 2.001)
    v_limit = np.float32(half_rows - 2.001)
    zero = np.float32(0.0)
    one = np.float32(1.0)
    nearer_u = np.float32(nearer[0] * scale)
    nearer_v = np.float32(nearer[1] * scale)
    nearer_w = np.float32(nearer[2])
    for p in range(x.size):
        if inverse_depth is None:
            w = one / (c0 + c1 * x[p])
            fine_u = (a0 + a1 * x[p]) * w + u_0
            fine_v = (b0 + b1 * x[p]) * w + v_0
        else:
            excess = inverse_depth[r, p] - one
            w = one / (c0 + c1 * x[p] + excess * nearer_w)
            fine_u = (a0 + a1 * x[p] + excess * nearer_u) * w + u_0
            fine_v = (b0 + b1 * x[p] + excess * nearer_v) * w + v_0
        # without branches, so that the loop is vectorised
        held_u = min(max(fine_u, zero), u_limit)
        held_v = min(max(fine_v, zero), v_limit)
        known = (held_u == fine_u) & (held_v == fine_v)
        inside[p] *= np.float32(known)
        i = np.int32(held_v)
        j = np.int32(held_u)
        f_u[p] = held_u - np.float32(j)
        f_v[p] = held_v - np.float32(i)
        at[p] = np.uint32(i * np.int32(half_columns) + j)


@njit(**INLINED)
def turned_places(x, h, y, half_width, u, v, inverse_depth, r, nearer):
    """Write places of the points of one row from where the centre has moved [half widths]."""
    mid_u = h[2] / h[8]
    mid_v = h[5] / h[8]
    inverse_width = np.float32(1.0 / half_width)
    for p in range(x.size):
        if inverse_depth is None:
            w = 1.0 / (h[7] * y + h[8] + h[6] * x[p])
            to_u = (h[1] * y + h[2] + h[0] * x[p]) * w
            to_v = (h[4] * y + h[5] + h[3] * x[p]) * w
        else:
            excess = inverse_depth[r, p] - 1.0
            w = 1.0 / (h[7] * y + h[8] + h[6] * x[p] + excess * nearer[2])
            to_u = (h[1] * y + h[2] + h[0] * x[p] + excess * nearer[0]) * w
            to_v = (h[4] * y + h[5] + h[3] * x[p] + excess * nearer[1]) * w
        u[p] = np.float32(to_u - mid_u) * inverse_width
        v[p] = np.float32(to_v - mid_v) * inverse_width


@njit(**INLINED)
def read_row(fine, half_columns, at, f_u, f_v, value, g_x, g_y):
    """Write value and gradient [1/half pixel] of the half-pixel reference in cells."""
    below = np.uint64(half_columns)
    one = np.uint64(1)
    for p in range(at.size):
        k = np.uint64(at[p])
        f00 = fine[k]
        f10 = fine[k + below]
        d0 = fine[k + one] - f00
        d1 = fine[k + below + one] - f10
        top = f00 + f_u[p] * d0
        bottom = f10 + f_u[p] * d1
        value[p] = top + f_v[p] * (bottom - top)
        g_x[p] = d0 + f_v[p] * (d1 - d0)
        g_y[p] = bottom - top


@njit(**INLINED)
def add_values(fine, half_columns, at, f_u, f_v, share, out):
    """Add `share` of the half-pixel image in cells to `out`."""
    below = np.uint64(half_columns)
    one = np.uint64(1)
    for p in range(at.size):
        k = np.uint64(at[p])
        top = fine[k] + f_u[p] * (fine[k + one] - fine[k])
        bottom = fine[k + below] + f_u[p] * (fine[k + below + one] - fine[k + below])
        out[p] += share * (top + f_v[p] * (bottom - top))


@njit(**INLINED)
def add_stretch(speed, pace, u, v, row_v, g_x, g_y, stretch):
    """
    Add `pace` times the change of value at the path's `speed` (6,), of background points.

    `row_v` is v of the row, taken for level here: exact where the camera is not turned.
    """
    u_0 = np.float32(pace * (speed[0] - speed[2] * row_v))
    u_1 = np.float32(pace * (speed[3] + speed[5] * row_v))
    u_2 = np.float32(pace * speed[4])
    v_0 = np.float32(pace * (speed[1] + speed[3] * row_v + speed[5] * row_v * row_v))
    v_1 = np.float32(pace * (speed[2] + speed[4] * row_v))
    for p in range(u.size):
        to_u = u_0 + u[p] * (u_1 + u[p] * u_2)
        to_v = v_0 + u[p] * v_1
        stretch[p] += g_x[p] * to_u + g_y[p] * to_v


@njit(**INLINED)
def move_columns(g_x, g_y, u, v, column):
    """Write derivatives (6, P) with respect to the path coordinates of points of the background."""
    for p in range(u.size):
        radial = g_x[p] * u[p] + g_y[p] * v[p]
        column[0, p] = g_x[p]
        column[1, p] = g_y[p]
        column[2, p] = g_y[p] * u[p] - g_x[p] * v[p]
        column[3, p] = radial
        column[4, p] = radial * u[p]
        column[5, p] = radial * v[p]


@njit(**INLINED)
def judge_row(x, values, mean, y_n, half_width, light, tones, gamma, gain, slope, residual):
    """
    Write gain, display residuals and d display / d light of a row.

    The tone curve is read from `tones`, see `normal_equations.tone_table`.
    """
    inverse_width = np.float32(1.0 / half_width)
    inverse_gamma = np.float32(1.0 / gamma)
    a0 = np.float32(light[0])
    a1 = np.float32(light[1])
    a2 = np.float32(light[2])
    a3 = np.float32(light[3])
    bias = np.float32(light[4])
    # three loops: only the one that reads the table is not vectorised
    for p in range(x.size):
        x_n = x[p] * inverse_width
        gain[p] = a0 + a1 * x_n + a2 * y_n + a3 * (x_n * x_n + y_n * y_n)
        linear = min(max(gain[p] * mean[p] + bias, DARKEST), BRIGHTEST)
        slope[p] = np.float32(math.sqrt(linear))
    for p in range(x.size):
        place = slope[p] * TONES
        whole = np.int32(place)
        k = np.uint64(np.uint32(whole))
        residual[p] = tones[k] + (place - np.float32(whole)) * (tones[k + np.uint64(1)] - tones[k])
    for p in range(x.size):
        shown = residual[p]
        slope[p] = shown * inverse_gamma / (slope[p] * slope[p])
        residual[p] = values[p] - shown


@njit(**INLINED)
def weigh_row(residual, edges, inside, sigma, misplaced, tukey, weight):
    """Write robust weights (Tukey or Huber); an edge is only as informative as its place."""
    noise = np.float32(sigma * sigma)
    reach = np.float32(misplaced * misplaced)
    inverse = np.float32(1.0 / sigma)
    for p in range(residual.size):
        # no object steals the path
        share = noise / (noise + edges[p] * reach)
        z = abs(residual[p]) * np.float32(math.sqrt(share)) * inverse
        if tukey:
            t = min(z * np.float32(0.2), np.float32(1.0))
            t = np.float32(1.0) - t * t
            weight[p] = t * t * share * inside[p]
        else:
            huber = min(np.float32(1.0), np.float32(2.0) / (z + np.float32(1e-9)))
            weight[p] = huber * share * inside[p]


@njit(**INLINED)
def light_rows(x, mean, mean_soft, stretch, y_n, half_width, gain, slope, jacobian):
    """Write the derivatives of display values with respect to the extras."""
    inverse_width = np.float32(1.0 / half_width)
    for p in range(x.size):
        x_n = x[p] * inverse_width
        shown = mean[p] * slope[p]
        jacobian[0, p] = shown
        jacobian[1, p] = shown * x_n
        jacobian[2, p] = shown * y_n
        jacobian[3, p] = shown * (x_n * x_n + y_n * y_n)
        jacobian[4, p] = BIAS_SCALE * slope[p]
        jacobian[5, p] = stretch[p] * gain[p] * slope[p]
        jacobian[6, p] = mean_soft[p] * gain[p] * slope[p]
        jacobian[7, p] = np.float32(0.0)


@njit(**INLINED)
def add_gradient(jacobian, count, weighted_residual, base, gradient):
    """
    Add the first `count` rows of a Jacobian times weighted residuals to a gradient.

    The `SPARE` rows after them are zeros.
    """
    for m in range(0, count, 4):
        j0 = jacobian[m]
        j1 = jacobian[m + 1]
        j2 = jacobian[m + 2]
        j3 = jacobian[m + 3]
        s0 = s1 = s2 = s3 = np.float32(0.0)
        for p in range(weighted_residual.size):
            s0 += weighted_residual[p] * j0[p]
            s1 += weighted_residual[p] * j1[p]
            s2 += weighted_residual[p] * j2[p]
            s3 += weighted_residual[p] * j3[p]
        to = m if m < AHEAD else base + m
        gradient[to] += s0
        gradient[to + 1] += s1
        gradient[to + 2] += s2
        gradient[to + 3] += s3


@njit(**INLINED)
def add_products(weighted, count, base, normal):
    """
    Add the products of `count` rows, each by the root of the weights, to an upper triangle.

    Four by four: eight loads then serve sixteen sums. The `SPARE` rows after them are zeros.
    """
    for m in range(0, count, 4):
        row = m if m < AHEAD else base + m
        m0 = weighted[m]
        m1 = weighted[m + 1]
        m2 = weighted[m + 2]
        m3 = weighted[m + 3]
        for n in range(0, m + 4, 4):
            to = n if n < AHEAD else base + n
            n0 = weighted[n]
            n1 = weighted[n + 1]
            n2 = weighted[n + 2]
            n3 = weighted[n + 3]
            s00 = s01 = s02 = s03 = np.float32(0.0)
            s10 = s11 = s12 = s13 = np.float32(0.0)
            s20 = s21 = s22 = s23 = np.float32(0.0)
            s30 = s31 = s32 = s33 = np.float32(0.0)
            for p in range(m0.size):
                s00 += m0[p] * n0[p]
                s01 += m0[p] * n1[p]
                s02 += m0[p] * n2[p]
                s03 += m0[p] * n3[p]
                s10 += m1[p] * n0[p]
                s11 += m1[p] * n1[p]
                s12 += m1[p] * n2[p]
                s13 += m1[p] * n3[p]
                s20 += m2[p] * n0[p]
                s21 += m2[p] * n1[p]
                s22 += m2[p] * n2[p]
                s23 += m2[p] * n3[p]
                s30 += m3[p] * n0[p]
                s31 += m3[p] * n1[p]
                s32 += m3[p] * n2[p]
                s33 += m3[p] * n3[p]
            normal[to, row] += s00
            normal[to, row + 1] += s10
            normal[to, row + 2] += s20
            normal[to, row + 3] += s30
            normal[to + 1, row] += s01
            normal[to + 1, row + 1] += s11
            normal[to + 1, row + 2] += s21
            normal[to + 1, row + 3] += s31
            normal[to + 2, row] += s02
            normal[to + 2, row + 1] += s12
            normal[to + 2, row + 2] += s22
            normal[to + 2, row + 3] += s32
            normal[to + 3, row] += s03
            normal[to + 3, row + 1] += s13
            normal[to + 3, row + 2] += s23
            normal[to + 3, row + 3] += s33


@njit(**INLINED)
def mark_outside(inside, residual):
    """Give points without reference, or switched off, a residual of 1e9."""
    for p in range(inside.size):
        if inside[p] == 0.0:
            residual[p] = np.float32(1e9)
