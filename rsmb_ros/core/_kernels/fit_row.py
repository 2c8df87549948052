"""One row of points in the path fit: where it lies, what it shows, what it says."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

EXTRA = 7  # unknowns after the control points: four gain coefficients, bias, exposure, defocus
SPARE = 3  # further rows of a Jacobian that are read, never used: sums are made four at a time
BIAS_SCALE = np.float32(10.0)  # grey levels per unit of the bias unknown


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
    half_rows, half_columns, columns, h, row, level, center, at, f_u, f_v, u_out, v_out, inside,
    inverse_depth, r, nearer,
):
    """
    Find where one instant puts the points of one row in the half-pixel reference.

    Writes the cell, the fractions in it and the place relative to the moved centre [px]. Points
    lie at `inverse_depth[r]`, see `depth.parallax`; None: all at 1, and compiled without.
    """
    scale = 2.0 / level
    shift = 1.0 / level - 1.0
    y = (row + 0.5) * level - 0.5 - center[1]
    a0 = h[1] * y + h[2]
    b0 = h[4] * y + h[5]
    c0 = h[7] * y + h[8]
    mid_u = h[2] / h[8]
    mid_v = h[5] / h[8]
    u_limit = half_columns - 2.001
    v_limit = half_rows - 2.001
    for p in range(columns.size):
        x = (columns[p] + 0.5) * level - 0.5 - center[0]
        if inverse_depth is None:
            w = 1.0 / (c0 + h[6] * x)
            u = (a0 + h[0] * x) * w
            v = (b0 + h[3] * x) * w
        else:
            excess = inverse_depth[r, p] - 1.0
            w = 1.0 / (c0 + h[6] * x + excess * nearer[2])
            u = (a0 + h[0] * x + excess * nearer[0]) * w
            v = (b0 + h[3] * x + excess * nearer[1]) * w
        fine_u = (u + center[2]) * scale + shift
        fine_v = (v + center[3]) * scale + shift
        # without branches, so that the loop is vectorised
        held_u = min(max(fine_u, 0.0), u_limit)
        held_v = min(max(fine_v, 0.0), v_limit)
        known = (held_u == fine_u) & (held_v == fine_v)
        inside[p] *= np.float32(known)
        fine_u = held_u
        fine_v = held_v
        i = np.int32(fine_v)
        j = np.int32(fine_u)
        f_u[p] = np.float32(fine_u - j)
        f_v[p] = np.float32(fine_v - i)
        at[p] = np.uint32(i * np.int32(half_columns) + j)
        u_out[p] = np.float32(u - mid_u)
        v_out[p] = np.float32(v - mid_v)


@njit(**INLINED)
def read_row(fine, half_columns, at, f_u, f_v, scale, value, g_x, g_y):
    """Write value and gradient [1/px of the full image] of the half-pixel reference in cells."""
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
        g_x[p] = (d0 + f_v[p] * (d1 - d0)) * scale
        g_y[p] = (bottom - top) * scale


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
def judge_row(
    columns, values, mean, y_n, level, center, half_width, light, gamma, gain, slope, residual
):
    """Write gain, display residuals and d display / d light of a row."""
    display = np.float32(1.0 / gamma)
    for p in range(columns.size):
        x_n = np.float32(((columns[p] + 0.5) * level - 0.5 - center[0]) / half_width)
        r2 = x_n * x_n + y_n * y_n
        gain[p] = np.float32(light[0] + light[1] * x_n + light[2] * y_n + light[3] * r2)
        linear = max(gain[p] * mean[p] + np.float32(light[4]), np.float32(0.25))
        shown = np.float32(255.0) * (linear / np.float32(255.0)) ** display
        slope[p] = shown / (linear * np.float32(gamma))
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
        z = abs(residual[p]) * math.sqrt(share) * inverse
        if tukey:
            t = min(z * np.float32(0.2), np.float32(1.0))
            t = np.float32(1.0) - t * t
            weight[p] = t * t * share * inside[p]
        else:
            huber = min(np.float32(1.0), np.float32(2.0) / (z + np.float32(1e-9)))
            weight[p] = huber * share * inside[p]


@njit(**INLINED)
def finish_row(
    columns, mean, mean_soft, stretch, y_n, level, center, half_width, gain, slope, active,
    jacobian,
):
    """Turn derivatives of light into derivatives of display values; add those of the extras."""
    for m in range(active):
        for p in range(columns.size):
            jacobian[m, p] *= gain[p] * slope[p]
    for p in range(columns.size):
        x_n = np.float32(((columns[p] + 0.5) * level - 0.5 - center[0]) / half_width)
        r2 = x_n * x_n + y_n * y_n
        jacobian[active, p] = mean[p] * slope[p]
        jacobian[active + 1, p] = mean[p] * x_n * slope[p]
        jacobian[active + 2, p] = mean[p] * y_n * slope[p]
        jacobian[active + 3, p] = mean[p] * r2 * slope[p]
        jacobian[active + 4, p] = BIAS_SCALE * slope[p]
        jacobian[active + 5, p] = stretch[p] * gain[p] * slope[p]
        jacobian[active + 6, p] = mean_soft[p] * gain[p] * slope[p]


@njit(**INLINED)
def add_row(
    jacobian, weight, residual, inside, active, base, extra, weighted, normal, gradient
):
    """Add one row to the normal equations (lower triangle), then mark its points outside."""
    points = weight.size
    for m in range(active + EXTRA):
        gm = base + m if m < active else extra + m - active
        # two loops: a sum beside a store adds up in an order that depends on where arrays lie
        for p in range(points):
            weighted[p] = jacobian[m, p] * weight[p]
        total_g = np.float32(0.0)
        for p in range(points):
            total_g += weighted[p] * residual[p]
        gradient[gm] += total_g
        # four at a time: one load of a weighted derivative serves four sums
        for n in range(0, m + 1, 4):
            h0 = np.float32(0.0)
            h1 = np.float32(0.0)
            h2 = np.float32(0.0)
            h3 = np.float32(0.0)
            for p in range(points):
                h0 += weighted[p] * jacobian[n, p]
                h1 += weighted[p] * jacobian[n + 1, p]
                h2 += weighted[p] * jacobian[n + 2, p]
                h3 += weighted[p] * jacobian[n + 3, p]
            four = (h0, h1, h2, h3)
            for i in range(min(4, m + 1 - n)):
                gn = base + n + i if n + i < active else extra + n + i - active
                normal[gm, gn] += four[i]
    mark_outside(inside, residual)


@njit(**INLINED)
def mark_outside(inside, residual):
    """Give points without reference, or switched off, a residual of 1e9."""
    for p in range(inside.size):
        if inside[p] == 0.0:
            residual[p] = np.float32(1e9)
