"""Normal equations of the path fit."""

from __future__ import annotations

import numpy as np
from numba import njit

from .depth import deepen_columns, parallax
from .fit_row import (
    EXTRA,
    add_row,
    add_values,
    finish_row,
    judge_row,
    mark_outside,
    place_row,
    read_row,
    weigh_row,
)
from .geometry import OPTIONS, basis_slope, homography, instant, instant_offset, span


@njit(**OPTIONS)
def linearise(
    first, last, fine, softer, half_rows, half_columns, rows, times, samples, columns, values,
    inverse_depth, control, first_time, knot_rows, exposure, softened, focal, center, level, dof,
    light, gamma, sigma, misplaced, tukey, normal, gradient, residuals, jacobians, knots_of, edges,
):
    """
    Add the points of rows[first:last] to the normal equations of Eq. 1 and 6.

    `softer` is what defocus by 1 px^2 adds to `fine`, `softened` how much of it [px^2].
    `misplaced` [px] is how far an edge may be from its place for reasons that are not the camera.
    Residuals are in display grey levels: live - display(gain * mean over the exposure + bias).
    Points with a negative value are switched off; they lie at `inverse_depth` (R, P), None: all on
    the background. `residuals` gets 1e9 where a point is off or has
    no reference. `jacobians`, `knots_of` (first knot and unknowns of a row) and `edges` keep
    what `correct` needs.
    """
    points = columns.shape[1]
    extra = control.shape[0] * dof
    half_width = center[0] + 0.5
    weighted = np.empty(points, np.float32)
    value = np.empty(points, np.float32)
    g_x = np.empty(points, np.float32)
    g_y = np.empty(points, np.float32)
    at = np.empty(points, np.uint32)
    f_u = np.empty(points, np.float32)
    f_v = np.empty(points, np.float32)
    u = np.empty(points, np.float32)
    v = np.empty(points, np.float32)
    column = np.empty((6, points), np.float32)
    mean = np.empty(points, np.float32)
    mean_x = np.empty(points, np.float32)
    mean_y = np.empty(points, np.float32)
    mean_soft = np.empty(points, np.float32)
    inside = np.empty(points, np.float32)
    stretch = np.empty(points, np.float32)
    weight = np.empty(points, np.float32)
    gain = np.empty(points, np.float32)
    slope = np.empty(points, np.float32)
    h = np.empty(9)
    far = np.empty(9)
    nearer = np.empty(3)
    q = np.zeros(6)
    speed = np.zeros(6)
    b = np.empty(4)
    slopes = np.empty(4)
    inverse_width = np.float32(1.0 / half_width)
    scale = np.float32(2.0 / level)
    for r in range(first, last):
        count = samples[r]
        share = np.float32(1.0 / count)
        begin = times[r] - 0.5 * exposure
        knot0, _ = span(begin, first_time, knot_rows, control.shape[0])
        knot1, _ = span(begin + exposure, first_time, knot_rows, control.shape[0])
        active = (knot1 - knot0 + 4) * dof
        jacobian = jacobians[r]
        knots_of[r, 0] = knot0
        knots_of[r, 1] = active
        for m in range(active):
            for p in range(points):
                jacobian[m, p] = 0.0
        for p in range(points):
            mean[p] = 0.0
            mean_x[p] = 0.0
            mean_y[p] = 0.0
            mean_soft[p] = 0.0
            stretch[p] = 0.0
            inside[p] = 1.0 if values[r, p] >= 0.0 else 0.0  # switched off: must not pull at all
        for k in range(count):
            offset = instant_offset(k, count)
            j, fraction = instant(
                times[r] + offset * exposure, control, first_time, knot_rows, b, q
            )
            basis_slope(fraction, slopes)
            for e in range(6):
                speed[e] = (
                    slopes[0] * control[j, e]
                    + slopes[1] * control[j + 1, e]
                    + slopes[2] * control[j + 2, e]
                    + slopes[3] * control[j + 3, e]
                ) / knot_rows
            homography(q, focal, half_width, 1.0, h)
            if inverse_depth is not None:
                parallax(q, focal, half_width, h, far, nearer)
            place_row(
                half_rows, half_columns, columns[r], h, rows[r], level, center, at, f_u, f_v, u,
                v, inside, inverse_depth, r, nearer,
            )
            read_row(fine, half_columns, at, f_u, f_v, scale, value, g_x, g_y)
            add_values(softer, half_columns, at, f_u, f_v, share, mean_soft)
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
            if inverse_depth is not None:
                deepen_columns(inverse_depth[r], h, nearer, focal, half_width, g_x, g_y, column)
            for e in range(dof):
                pace = np.float32(speed[e] * offset) * share
                for p in range(points):
                    stretch[p] += pace * column[e, p]
            for n in range(4):
                part = np.float32(b[n]) * share
                to = (j + n - knot0) * dof
                for e in range(dof):
                    for p in range(points):
                        jacobian[to + e, p] += part * column[e, p]
        y_n = np.float32(((rows[r] + 0.5) * level - 0.5 - center[1]) / half_width)
        for p in range(points):
            mean[p] += np.float32(softened) * mean_soft[p]
        judge_row(
            columns[r], values[r], mean, y_n, level, center, half_width, light, gamma, gain, slope,
            residuals[r],
        )
        for p in range(points):
            edges[r, p] = (mean_x[p] ** 2 + mean_y[p] ** 2) * (gain[p] * slope[p]) ** 2
        weigh_row(residuals[r], edges[r], inside, sigma, misplaced, tukey, weight)
        finish_row(
            columns[r], mean, mean_soft, stretch, y_n, level, center, half_width, gain, slope,
            active, jacobian,
        )
        add_row(
            jacobian, weight, residuals[r], inside, active, knot0 * dof, extra, weighted, normal,
            gradient,
        )


@njit(**OPTIONS)
def correct(
    first, last, fine, softer, half_rows, half_columns, rows, times, samples, columns, values,
    inverse_depth, control, first_time, knot_rows, exposure, softened, focal, center, level, dof,
    light, gamma, sigma, misplaced, tukey, gradient, residuals, jacobians, knots_of, edges,
):
    """Write residuals and their gradient on the Jacobians of the last `linearise`."""
    points = columns.shape[1]
    extra = control.shape[0] * dof
    half_width = center[0] + 0.5
    at = np.empty(points, np.uint32)
    f_u = np.empty(points, np.float32)
    f_v = np.empty(points, np.float32)
    u = np.empty(points, np.float32)
    v = np.empty(points, np.float32)
    mean = np.empty(points, np.float32)
    inside = np.empty(points, np.float32)
    weight = np.empty(points, np.float32)
    gain = np.empty(points, np.float32)
    slope = np.empty(points, np.float32)
    h = np.empty(9)
    far = np.empty(9)
    nearer = np.empty(3)
    q = np.zeros(6)
    b = np.empty(4)
    for r in range(first, last):
        count = samples[r]
        share = np.float32(1.0 / count)
        for p in range(points):
            mean[p] = 0.0
            inside[p] = 1.0 if values[r, p] >= 0.0 else 0.0
        for k in range(count):
            offset = instant_offset(k, count)
            instant(times[r] + offset * exposure, control, first_time, knot_rows, b, q)
            homography(q, focal, half_width, 1.0, h)
            if inverse_depth is not None:
                parallax(q, focal, half_width, h, far, nearer)
            place_row(
                half_rows, half_columns, columns[r], h, rows[r], level, center, at, f_u, f_v, u,
                v, inside, inverse_depth, r, nearer,
            )
            add_values(fine, half_columns, at, f_u, f_v, share, mean)
            if softened != 0.0:
                add_values(
                    softer, half_columns, at, f_u, f_v, np.float32(softened) * share, mean
                )
        y_n = np.float32(((rows[r] + 0.5) * level - 0.5 - center[1]) / half_width)
        judge_row(
            columns[r], values[r], mean, y_n, level, center, half_width, light, gamma, gain, slope,
            residuals[r],
        )
        weigh_row(residuals[r], edges[r], inside, sigma, misplaced, tukey, weight)
        active = knots_of[r, 1]
        base = knots_of[r, 0] * dof
        jacobian = jacobians[r]
        for p in range(points):
            weight[p] *= residuals[r, p]
        for m in range(active + EXTRA):
            total = np.float32(0.0)
            for p in range(points):
                total += weight[p] * jacobian[m, p]
            gradient[base + m if m < active else extra + m - active] += total
        mark_outside(inside, residuals[r])
