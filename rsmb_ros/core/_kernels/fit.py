"""Normal equations of the path fit."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import OPTIONS, basis, basis_slope, homography, span

EXTRA = 6  # unknowns after the control points: four gain coefficients, bias, exposure
BIAS_SCALE = np.float32(10.0)  # grey levels per unit of the bias unknown


@njit(**OPTIONS)
def strongest_gradients(image, rows, bin_width, columns, values):
    """Write, per row and bin, the column of the largest |dx| + |dy| and the value there."""
    height, width = image.shape
    for r in range(rows.size):
        y = rows[r]
        above = max(y - 1, 0)
        below = min(y + 1, height - 1)
        for b in range(columns.shape[1]):
            best = np.float32(-1.0)
            best_x = 1
            for x in range(max(1, b * bin_width), min(width - 1, (b + 1) * bin_width)):
                strength = abs(image[y, x + 1] - image[y, x - 1]) + abs(
                    image[below, x] - image[above, x]
                )
                if strength > best:
                    best = strength
                    best_x = x
            columns[r, b] = best_x
            values[r, b] = image[y, best_x]


@njit(**OPTIONS)
def sample_row(
    fine, half_rows, half_columns, columns, h, row, level, center,
    value, g_x, g_y, u_out, v_out, inside,
):
    """
    Sample the half-pixel reference where one instant puts the points of one row.

    Writes value, gradient [1/px of the full image] and place relative to the moved centre.
    """
    scale = np.float32(2.0 / level)
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
        w = 1.0 / (c0 + h[6] * x)
        u = (a0 + h[0] * x) * w
        v = (b0 + h[3] * x) * w
        fine_u = (u + center[2]) * scale + shift
        fine_v = (v + center[3]) * scale + shift
        if not (0.0 <= fine_u <= u_limit and 0.0 <= fine_v <= v_limit):
            inside[p] = np.float32(0.0)
            fine_u = min(max(fine_u, 0.0), u_limit)
            fine_v = min(max(fine_v, 0.0), v_limit)
        i = int(fine_v)
        j = int(fine_u)
        f_u = np.float32(fine_u - j)
        f_v = np.float32(fine_v - i)
        at = i * half_columns + j
        f00 = fine[at]
        f10 = fine[at + half_columns]
        d0 = fine[at + 1] - f00
        d1 = fine[at + half_columns + 1] - f10
        top = f00 + f_u * d0
        bottom = f10 + f_u * d1
        value[p] = top + f_v * (bottom - top)
        g_x[p] = (d0 + f_v * (d1 - d0)) * scale
        g_y[p] = (bottom - top) * scale
        u_out[p] = np.float32(u - mid_u)
        v_out[p] = np.float32(v - mid_v)


@njit(**OPTIONS)
def accumulate(
    first, last, fine, half_rows, half_columns, rows, times, samples, columns, values, control,
    first_time, knot_rows, exposure, focal, center, level, dof, light, gamma, sigma,
    misplaced, tukey, normal, gradient, residuals,
):
    """
    Add the points of rows[first:last] to the normal equations of Eq. 1 and 6.

    `misplaced` [px] is how far an edge may be from its place for reasons that are not the camera.
    Residuals are in display grey levels: live - display(gain * mean over the exposure + bias).
    Points with a negative value are switched off. `residuals` gets 1e9 where a point is off or has
    no reference.
    """
    points = columns.shape[1]
    knots = control.shape[0]
    extra = knots * dof
    half_width = center[0] + 0.5
    span_knots = int(exposure / knot_rows) + 6
    size = span_knots * dof + EXTRA
    jacobian = np.zeros((size, points), np.float32)
    weighted = np.empty(points, np.float32)
    value = np.empty(points, np.float32)
    g_x = np.empty(points, np.float32)
    g_y = np.empty(points, np.float32)
    u = np.empty(points, np.float32)
    v = np.empty(points, np.float32)
    column = np.empty((6, points), np.float32)
    mean = np.empty(points, np.float32)
    mean_x = np.empty(points, np.float32)
    mean_y = np.empty(points, np.float32)
    inside = np.empty(points, np.float32)
    stretch = np.empty(points, np.float32)
    weight = np.empty(points, np.float32)
    residual = np.empty(points, np.float32)
    h = np.empty(9)
    q = np.zeros(6)
    speed = np.zeros(6)
    b = np.empty(4)
    slope = np.empty(4)
    inverse_width = np.float32(1.0 / half_width)
    display = np.float32(1.0 / gamma)
    for r in range(first, last):
        count = samples[r]
        share = np.float32(1.0 / count)
        begin = times[r] - 0.5 * exposure
        knot0, _ = span(begin, first_time, knot_rows, knots)
        knot1, _ = span(begin + exposure, first_time, knot_rows, knots)
        active = (knot1 - knot0 + 4) * dof
        for m in range(active):
            for p in range(points):
                jacobian[m, p] = 0.0
        for p in range(points):
            mean[p] = 0.0
            mean_x[p] = 0.0
            mean_y[p] = 0.0
            stretch[p] = 0.0
            inside[p] = 1.0 if values[r, p] >= 0.0 else 0.0  # switched off: must not pull at all
        for k in range(count):
            offset = (k + 0.5) / count - 0.5
            j, fraction = span(times[r] + offset * exposure, first_time, knot_rows, knots)
            basis(fraction, b)
            basis_slope(fraction, slope)
            for e in range(6):
                q[e] = (
                    b[0] * control[j, e]
                    + b[1] * control[j + 1, e]
                    + b[2] * control[j + 2, e]
                    + b[3] * control[j + 3, e]
                )
                speed[e] = (
                    slope[0] * control[j, e]
                    + slope[1] * control[j + 1, e]
                    + slope[2] * control[j + 2, e]
                    + slope[3] * control[j + 3, e]
                ) / knot_rows
            homography(q, focal, half_width, 1.0, h)
            sample_row(
                fine, half_rows, half_columns, columns[r], h, rows[r], level, center,
                value, g_x, g_y, u, v, inside,
            )
            for p in range(points):
                u_n = u[p] * inverse_width
                v_n = v[p] * inverse_width
                radial = g_x[p] * u_n + g_y[p] * v_n
                mean[p] += value[p] * share
                mean_x[p] += g_x[p] * share
                mean_y[p] += g_y[p] * share
                column[0, p] = g_x[p]
                column[1, p] = g_y[p]
                column[2, p] = g_y[p] * u_n - g_x[p] * v_n
                column[3, p] = radial
                column[4, p] = radial * u_n
                column[5, p] = radial * v_n
            for e in range(dof):
                pace = np.float32(speed[e] * offset) * share
                for p in range(points):
                    stretch[p] += pace * column[e, p]
            for n in range(4):
                part = np.float32(b[n]) * share
                at = (j + n - knot0) * dof
                for e in range(dof):
                    for p in range(points):
                        jacobian[at + e, p] += part * column[e, p]
        y_n = ((rows[r] + 0.5) * level - 0.5 - center[1]) / half_width
        weight_row(
            columns[r], values[r], mean, mean_x, mean_y, inside, y_n, level, center, half_width,
            light, display, gamma, sigma, misplaced, tukey, jacobian, active, stretch, weight,
            residual,
        )
        for p in range(points):
            residuals[r, p] = residual[p] if inside[p] > 0.0 else np.float32(1e9)
        total = active + EXTRA
        base = knot0 * dof
        for m in range(total):
            gm = base + m if m < active else extra + m - active
            # two loops: a sum beside a store adds up in an order that depends on where arrays lie
            for p in range(points):
                weighted[p] = jacobian[m, p] * weight[p]
            total_g = np.float32(0.0)
            for p in range(points):
                total_g += weighted[p] * residual[p]
            gradient[gm] += total_g
            for n in range(m + 1):
                gn = base + n if n < active else extra + n - active
                total_h = np.float32(0.0)
                for p in range(points):
                    total_h += weighted[p] * jacobian[n, p]
                normal[gm, gn] += total_h


@njit(**OPTIONS)
def weight_row(
    columns, values, mean, mean_x, mean_y, inside, y_n, level, center, half_width, light, display,
    gamma, sigma, misplaced, tukey, jacobian, active, stretch, weight, residual,
):
    """Finish one row: photometric columns, display residual, robust weight (Tukey or Huber)."""
    for p in range(columns.size):
        x_n = np.float32(((columns[p] + 0.5) * level - 0.5 - center[0]) / half_width)
        r2 = x_n * x_n + np.float32(y_n * y_n)
        gain = np.float32(light[0] + light[1] * x_n + light[2] * y_n + light[3] * r2)
        linear = max(gain * mean[p] + np.float32(light[4]), np.float32(0.25))
        shown = np.float32(255.0) * (linear / np.float32(255.0)) ** display
        slope = shown / (linear * np.float32(gamma))  # d display / d linear
        for m in range(active):
            jacobian[m, p] *= gain * slope
        jacobian[active, p] = mean[p] * slope
        jacobian[active + 1, p] = mean[p] * x_n * slope
        jacobian[active + 2, p] = mean[p] * np.float32(y_n) * slope
        jacobian[active + 3, p] = mean[p] * r2 * slope
        jacobian[active + 4, p] = BIAS_SCALE * slope
        jacobian[active + 5, p] = stretch[p] * gain * slope
        r = values[p] - shown
        residual[p] = r
        # an edge is only as informative as its place can be trusted: no object steals the path
        edge2 = (mean_x[p] ** 2 + mean_y[p] ** 2) * (gain * slope * np.float32(misplaced)) ** 2
        share = np.float32(sigma * sigma) / (np.float32(sigma * sigma) + edge2)
        z = abs(r) * math.sqrt(share) / np.float32(sigma)
        if tukey:
            t = min(z / np.float32(5.0), np.float32(1.0))
            t = np.float32(1.0) - t * t
            weight[p] = t * t * share * inside[p]
        else:
            huber = min(np.float32(1.0), np.float32(2.0) / (z + np.float32(1e-9)))
            weight[p] = huber * share * inside[p]
