"""Normal equations of the path fit."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .depth import deepen_columns, parallax
from .fit_row import (
    AHEAD,
    SPARE,
    add_gradient,
    add_products,
    add_stretch,
    add_values,
    judge_row,
    light_rows,
    mark_outside,
    move_columns,
    place_row,
    read_row,
    turned_places,
    weigh_row,
)
from .geometry import INLINED, OPTIONS, basis_slope, homography, instant, instant_offset, span

MUCH_SOFTER = 0.1  # px^2 of defocus, beyond which it is looked up at each instant, each time
FEW = 3  # instants; of more than that, every other one tells what little defocus does


@njit(inline='always', **OPTIONS)
def tells_defocus(k, count, row):
    """
    Return whether instant `k` of `count` is one of every other, from the ends to the middle.

    Rows in turn begin with the first or the second, so that not all blur too far, or too little.
    """
    return min(k, count - 1 - k) % 2 == row % 2


@njit(inline='always', **OPTIONS)
def defocus_share(count, row):
    """Return the weight of each instant for which `tells_defocus` is true."""
    seconds = 2 * (count // 4) + (count % 4) // 3
    return np.float32(1.0 / (seconds if row % 2 == 1 else count - seconds))


@njit(**INLINED)
def linearise(
    first, last, bounds, fine, softer, half_rows, half_columns, rows, times, samples, places,
    values, inverse_depth, control, first_time, knot_rows, exposure, softened, focal, center, level,
    dof, light, tones, gamma, sigma, misplaced, tukey, lens, begins, normal, gradient, residuals,
    jacobians, knots_of, edges, soft,
):
    """
    Write the normal equations of Eq. 1 and 6 of each of chunks[first:last] of the rows of points.

    Chunk c holds rows[bounds[c]:bounds[c + 1]]. Its `normal[c]` (S, S), upper triangle, and
    `gradient[c]` (S,) hold the extras, `AHEAD` of them, then the unknowns of its knots from
    `begins[c]` on.
    `places` (R, P) are the points' columns from the live centre [px].
    `softer` is what defocus by 1 px^2 adds to `fine`, `softened` how much of it [px^2]. `lens` says
    whether that is an unknown; else, without any, the image is not read. Of little, every other
    instant is enough: it is as much to read as all the rest.
    `misplaced` [px] is how far an edge may be from its place for reasons that are not the camera.
    Residuals are in display grey levels: live - display(gain * mean over the exposure + bias).
    Points with a negative value are switched off; they lie at `inverse_depth` (R, P), None: all on
    the background. `residuals` gets 1e9 where a point is off or has no reference. `jacobians`,
    `knots_of` (first knot and unknowns of a row), `edges` and `soft` keep what `correct` needs.
    """
    points = places.shape[1]
    knots = control.shape[0]
    half_width = center[0] + 0.5
    most = jacobians.shape[1]
    weighted = np.zeros((most, points), np.float32)
    knot_g = np.empty((most // dof + 1, 2 * points), np.float32)  # gradients x, then y
    value = np.empty(points, np.float32)
    g = np.empty(2 * points, np.float32)
    g_x = g[:points]
    g_y = g[points:]
    at = np.empty(points, np.uint32)
    f_u = np.empty(points, np.float32)
    f_v = np.empty(points, np.float32)
    u = np.empty(points, np.float32)
    v = np.empty(points, np.float32)
    column = np.empty((6, points), np.float32)
    mean = np.empty(points, np.float32)
    inside = np.empty(points, np.float32)
    stretch = np.empty(points, np.float32)
    weight = np.empty(points, np.float32)
    gain = np.empty(points, np.float32)
    slope = np.empty(points, np.float32)
    h = np.empty(9)
    middle = np.empty(9)
    far = np.empty(9)
    nearer = np.zeros(3)
    middle_nearer = np.zeros(3)
    q = np.zeros(6)
    speed = np.zeros(6)
    b = np.empty(4)
    slopes = np.empty(4)
    scale = np.float32(2.0 / level)
    blurs = lens or softened != 0.0
    much = abs(softened) > MUCH_SOFTER
    for chunk in range(first, last):
        normal[chunk] = 0.0
        gradient[chunk] = 0.0
        begins[chunk] = knots
        for r in range(bounds[chunk], bounds[chunk + 1]):
            knot, _ = span(times[r] - 0.5 * exposure, first_time, knot_rows, knots)
            begins[chunk] = min(begins[chunk], knot)
        for r in range(bounds[chunk], bounds[chunk + 1]):
            count = samples[r]
            share = np.float32(1.0 / count)
            every = much or count <= FEW
            lens_share = share if every else defocus_share(count, r)
            begin = times[r] - 0.5 * exposure
            knot0, _ = span(begin, first_time, knot_rows, knots)
            knot1, _ = span(begin + exposure, first_time, knot_rows, knots)
            touched = knot1 - knot0 + 4
            jacobian = jacobians[r]
            knots_of[r, 0] = knot0
            knots_of[r, 1] = touched * dof
            mean_soft = soft[r]
            mean[:] = 0.0
            mean_soft[:] = 0.0
            stretch[:] = 0.0
            knot_g[:touched] = 0.0
            for p in range(points):
                inside[p] = 1.0 if values[r, p] >= 0.0 else 0.0
            y = (rows[r] + 0.5) * level - 0.5 - center[1]
            x = places[r]
            # derivatives with respect to the path are those of the middle of the exposure
            instant(times[r], control, first_time, knot_rows, b, q)
            homography(q, focal, half_width, 1.0, middle)
            if inverse_depth is not None:
                parallax(q, focal, half_width, middle, far, middle_nearer)
            turned_places(x, middle, y, half_width, u, v, inverse_depth, r, middle_nearer)
            row_v = (
                (middle[4] * y + middle[5]) / (middle[7] * y + middle[8]) - middle[5] / middle[8]
            ) / half_width
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
                    half_rows, half_columns, x, h, y, level, center, at, f_u, f_v, inside,
                    inverse_depth, r, nearer,
                )
                read_row(fine, half_columns, at, f_u, f_v, value, g_x, g_y)
                if blurs and (every or tells_defocus(k, count, r)):
                    add_values(softer, half_columns, at, f_u, f_v, lens_share, mean_soft)
                for p in range(points):
                    mean[p] += value[p] * share
                for n in range(4):
                    part = np.float32(b[n]) * share * scale
                    to = knot_g[j + n - knot0]
                    for p in range(2 * points):
                        to[p] += part * g[p]
                pace = offset / count * 2.0 / level
                if inverse_depth is None:
                    add_stretch(speed, pace, u, v, row_v, g_x, g_y, stretch)
                else:
                    move_columns(g_x, g_y, u, v, column)
                    deepen_columns(
                        inverse_depth[r], h, nearer, focal, half_width, g_x, g_y, column
                    )
                    for e in range(dof):
                        part = np.float32(pace * speed[e])
                        for p in range(points):
                            stretch[p] += part * column[e, p]
            y_n = np.float32(y / half_width)
            for p in range(points):
                mean[p] += np.float32(softened) * mean_soft[p]
            judge_row(
                x, values[r], mean, y_n, half_width, light, tones, gamma, gain, slope, residuals[r]
            )
            # spline weights sum to 1: the knots' parts add up to the gradient of the row
            g[:] = 0.0
            for n in range(touched):
                for p in range(2 * points):
                    g[p] += knot_g[n, p]
            for p in range(points):
                bright = gain[p] * slope[p]
                edges[r, p] = (g_x[p] * g_x[p] + g_y[p] * g_y[p]) * (bright * bright)
            weigh_row(residuals[r], edges[r], inside, sigma, misplaced, tukey, weight)
            light_rows(x, mean, mean_soft, stretch, y_n, half_width, gain, slope, jacobian)
            for p in range(points):
                slope[p] *= gain[p]
            for n in range(touched):
                for p in range(points):
                    g_x[p] = knot_g[n, p] * slope[p]
                    g_y[p] = knot_g[n, points + p] * slope[p]
                # all six, of which those beyond `dof` are overwritten by the next knot's
                to_jacobian = jacobian[AHEAD + n * dof : AHEAD + n * dof + 6]
                move_columns(g_x, g_y, u, v, to_jacobian)
                if inverse_depth is not None:
                    deepen_columns(
                        inverse_depth[r], middle, middle_nearer, focal, half_width, g_x, g_y,
                        to_jacobian,
                    )
            unknowns = AHEAD + touched * dof
            jacobian[unknowns : unknowns + SPARE] = 0.0
            for p in range(points):
                slope[p] = np.float32(math.sqrt(weight[p]))
                weight[p] *= residuals[r, p]
            for m in range(unknowns + SPARE):
                for p in range(points):
                    weighted[m, p] = jacobian[m, p] * slope[p]
            base = (knot0 - begins[chunk]) * dof
            add_products(weighted, unknowns, base, normal[chunk])
            add_gradient(jacobian, unknowns, weight, base, gradient[chunk])
            mark_outside(inside, residuals[r])


@njit(**INLINED)
def correct(
    first, last, bounds, fine, softer, half_rows, half_columns, rows, times, samples, places,
    values, inverse_depth, control, first_time, knot_rows, exposure, softened, focal, center, level,
    dof, light, tones, gamma, sigma, misplaced, tukey, lens, begins, normal, gradient, residuals,
    jacobians, knots_of, edges, soft,
):
    """
    Write residuals and their gradient on the Jacobians of the last `linearise`.

    Little defocus is taken from there, too: it changes less between here and there than it is.
    """
    points = places.shape[1]
    half_width = center[0] + 0.5
    much = abs(softened) > MUCH_SOFTER
    at = np.empty(points, np.uint32)
    f_u = np.empty(points, np.float32)
    f_v = np.empty(points, np.float32)
    mean = np.empty(points, np.float32)
    inside = np.empty(points, np.float32)
    weight = np.empty(points, np.float32)
    gain = np.empty(points, np.float32)
    slope = np.empty(points, np.float32)
    h = np.empty(9)
    far = np.empty(9)
    nearer = np.zeros(3)
    q = np.zeros(6)
    b = np.empty(4)
    for chunk in range(first, last):
        gradient[chunk] = 0.0
        for r in range(bounds[chunk], bounds[chunk + 1]):
            count = samples[r]
            share = np.float32(1.0 / count)
            for p in range(points):
                mean[p] = np.float32(0.0) if much else np.float32(softened) * soft[r, p]
                inside[p] = 1.0 if values[r, p] >= 0.0 else 0.0
            y = (rows[r] + 0.5) * level - 0.5 - center[1]
            for k in range(count):
                offset = instant_offset(k, count)
                instant(times[r] + offset * exposure, control, first_time, knot_rows, b, q)
                homography(q, focal, half_width, 1.0, h)
                if inverse_depth is not None:
                    parallax(q, focal, half_width, h, far, nearer)
                place_row(
                    half_rows, half_columns, places[r], h, y, level, center, at, f_u, f_v, inside,
                    inverse_depth, r, nearer,
                )
                add_values(fine, half_columns, at, f_u, f_v, share, mean)
                if much:
                    add_values(
                        softer, half_columns, at, f_u, f_v, np.float32(softened) * share, mean
                    )
            y_n = np.float32(y / half_width)
            judge_row(
                places[r], values[r], mean, y_n, half_width, light, tones, gamma, gain, slope,
                residuals[r],
            )
            weigh_row(residuals[r], edges[r], inside, sigma, misplaced, tukey, weight)
            for p in range(points):
                weight[p] *= residuals[r, p]
            base = (knots_of[r, 0] - begins[chunk]) * dof
            add_gradient(jacobians[r], AHEAD + knots_of[r, 1], weight, base, gradient[chunk])
            mark_outside(inside, residuals[r])
