"""
The sparse normal equations of a path: put together, given beliefs, solved.

A control point shares exposures only with its neighbours, all of them with the extras. The matrix
is an arrow: `band` (D, W) holds N[j + d, j] at [j, d] for the D path unknowns, `border` (D, AHEAD)
the extras' products with them, `corner` (AHEAD, AHEAD) those of the extras, lower triangle.
Vectors (D + AHEAD,) hold the path first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .fit_row import AHEAD, EXPOSED, EXTRA
from .geometry import INLINED, OPTIONS

DAMPING = 1e-4  # of the mean curvature, on all that is not held stiff


class Beliefs(NamedTuple):
    """
    What is believed of a path before the data are seen.

    `bands` (knots, 3, dof) is a penalty between a control point and itself, the next, and the one
    after it, in units of the mean curvature times the stiffness; `ridge` (dof,) one on each of
    them, `trust` one on an exposure other than `exposure` [rows], both in units of the residuals'
    variance. Extras that are `fixed` (AHEAD,) bool drop out.
    """

    bands: np.ndarray
    ridge: np.ndarray
    trust: float
    exposure: float
    fixed: np.ndarray


@njit(**INLINED)
def add_to(row, begin, out, count):
    """Add row[begin:] to `out`."""
    begin = np.uint64(begin)
    for k in range(np.uint64(count)):
        out[k] += row[begin + k]


@njit(**INLINED)
def assemble(begins, dof, normals, band, border, corner):
    """Write the sum of chunks' upper triangles (C, S, S) into an arrow, chunk after chunk."""
    unknowns, width = band.shape
    band[:] = 0.0
    border[:] = 0.0
    corner[:] = 0.0
    for chunk in range(begins.size):
        base = begins[chunk] * dof
        normal = normals[chunk]
        for x in range(AHEAD):
            for y in range(x + 1):
                corner[x, y] += normal[y, x]
        size = min(unknowns - base, normal.shape[0] - AHEAD)
        for i in range(size):
            for x in range(AHEAD):
                border[base + i, x] += normal[x, AHEAD + i]
            add_to(normal[AHEAD + i], AHEAD + i, band[base + i], min(width, size - i))


@njit(**INLINED)
def assemble_gradient(begins, dof, gradients, out):
    """Write the sum of chunks' gradients (C, S) into a vector (D + AHEAD,)."""
    unknowns = out.size - AHEAD
    out[:] = 0.0
    for chunk in range(begins.size):
        base = begins[chunk] * dof
        for x in range(AHEAD):
            out[unknowns + x] += gradients[chunk, x]
        for i in range(min(unknowns - base, gradients.shape[1] - AHEAD)):
            out[base + i] += gradients[chunk, AHEAD + i]


@njit(**INLINED)
def believe(
    beliefs, stiffness, control, exposure, sigma, band, border, corner, gradient
):
    """
    Add `Beliefs` to an arrow and its gradient, linearised at a path's `control` and `exposure`.

    `sigma` is the standard deviation of the residuals [grey levels].
    """
    bands = beliefs.bands
    knots, _, dof = bands.shape
    variance = sigma * sigma
    damping = DAMPING * min(1.0, 10.0 * stiffness)
    unknowns = band.shape[0]
    curvature = 0.0
    for j in range(unknowns):
        curvature += band[j, 0]
    curvature = curvature / unknowns + 1e-9
    scale = curvature * stiffness
    for k in range(knots):
        for e in range(dof):
            j = k * dof + e
            own = scale * bands[k, 0, e] + variance * beliefs.ridge[e]
            band[j, 0] += own
            gradient[j] -= own * control[k, e]
            for ahead in range(1, min(3, knots - k)):
                weight = scale * bands[k, ahead, e]
                band[j, ahead * dof] += weight
                gradient[j] -= weight * control[k + ahead, e]
                gradient[j + ahead * dof] -= weight * control[k, e]
            # damping keeps knots without data in place; it does not bias the solution
            band[j, 0] += damping * curvature + 1e-9
    for x in range(AHEAD):
        corner[x, x] += 1e-6 * corner[x, x] + 1e-6
    trust = variance * beliefs.trust
    corner[EXPOSED, EXPOSED] += trust
    gradient[unknowns + EXPOSED] += trust * (beliefs.exposure - exposure)
    for x in range(AHEAD):
        if beliefs.fixed[x]:
            for j in range(unknowns):
                border[j, x] = 0.0
            for y in range(AHEAD):
                corner[max(x, y), min(x, y)] = 0.0
            corner[x, x] = 1.0
            gradient[unknowns + x] = 0.0


@njit(**INLINED)
def take_off(factor, row, begin, out, count):
    """Subtract `factor` times row[begin:] from `out`."""
    begin = np.uint64(begin)
    for k in range(np.uint64(count)):
        out[k] -= factor * row[begin + k]


@njit(**INLINED)
def take_off_four(factors, at, rows, begin, out, count):
    """Subtract factors[m, at] times rows[m, begin:] from `out`, for the four m at once."""
    at = np.uint64(at)
    begin = np.uint64(begin)
    f0 = factors[0, at]
    f1 = factors[1, at]
    f2 = factors[2, at]
    f3 = factors[3, at]
    r0 = rows[0]
    r1 = rows[1]
    r2 = rows[2]
    r3 = rows[3]
    for k in range(np.uint64(count)):
        n = begin + k
        out[k] -= f0 * r0[n] + f1 * r1[n] + f2 * r2[n] + f3 * r3[n]


@njit(**INLINED)
def factorise(band, border, corner):
    """
    Replace an arrow by its Cholesky factor; return whether it is positive definite.

    Four columns at a time: what lies behind them is then loaded and stored once for the four.
    """
    unknowns, width = band.shape
    below = np.empty((4, width))
    beside = np.empty((4, AHEAD))
    for begin in range(0, unknowns, 4):
        end = min(begin + 4, unknowns)
        below[:] = 0.0
        beside[:] = 0.0
        for j in range(begin, end):
            if not band[j, 0] > 0.0:
                return False
            inverse = 1.0 / math.sqrt(band[j, 0])
            reach = min(width, unknowns - j)
            for d in range(reach):
                band[j, d] *= inverse
            for x in range(AHEAD):
                border[j, x] *= inverse
            for d in range(1, min(end - j, reach)):
                take_off(band[j, d], band[j], d, band[j + d], reach - d)
                take_off(band[j, d], border[j], 0, border[j + d], AHEAD)
            for d in range(end - j, reach):
                below[j - begin, d - (end - j)] = band[j, d]
            for x in range(AHEAD):
                beside[j - begin, x] = border[j, x]
                for y in range(x + 1):
                    corner[x, y] -= border[j, x] * border[j, y]
        behind = min(width - 1, unknowns - end)
        for t in range(behind):
            take_off_four(below, t, below, t, band[end + t], behind - t)
            take_off_four(below, t, beside, 0, border[end + t], AHEAD)
    for y in range(AHEAD):
        if not corner[y, y] > 0.0:
            return False
        corner[y, y] = math.sqrt(corner[y, y])
        for x in range(y + 1, AHEAD):
            corner[x, y] /= corner[y, y]
        for x in range(y + 1, AHEAD):
            for z in range(y + 1, x + 1):
                corner[x, z] -= corner[x, y] * corner[z, y]
    return True


@njit(**INLINED)
def substitute(band, border, corner, vector):
    """Replace a vector by the solution of an arrow that is factorised."""
    unknowns, width = band.shape
    for j in range(unknowns):
        vector[j] /= band[j, 0]
        for d in range(1, min(width, unknowns - j)):
            vector[j + d] -= band[j, d] * vector[j]
        for x in range(AHEAD):
            vector[unknowns + x] -= border[j, x] * vector[j]
    for y in range(AHEAD):
        vector[unknowns + y] /= corner[y, y]
        for x in range(y + 1, AHEAD):
            vector[unknowns + x] -= corner[x, y] * vector[unknowns + y]
    for y in range(AHEAD - 1, -1, -1):
        for x in range(y + 1, AHEAD):
            vector[unknowns + y] -= corner[x, y] * vector[unknowns + x]
        vector[unknowns + y] /= corner[y, y]
    for j in range(unknowns - 1, -1, -1):
        total = vector[j]
        for x in range(AHEAD):
            total -= border[j, x] * vector[unknowns + x]
        for d in range(1, min(width, unknowns - j)):
            total -= band[j, d] * vector[j + d]
        vector[j] = total / band[j, 0]


@njit(**OPTIONS)
def written_out(band, border, corner, out):
    """Write an arrow as a lower triangle (D + EXTRA, D + EXTRA)."""
    unknowns, width = band.shape
    for j in range(unknowns):
        for d in range(min(width, unknowns - j)):
            out[j + d, j] = band[j, d]
        for x in range(EXTRA):
            out[unknowns + x, j] = border[j, x]
    for x in range(EXTRA):
        for y in range(x + 1):
            out[unknowns + x, unknowns + y] = corner[x, y]


@njit(**INLINED)
def row_steps(step, dof, times, first_time, knot_rows, knots, reach, seen):
    """Return how far a step moves the rows that are `seen`, mean square [px^2]."""
    total = 0.0
    count = 0
    for r in range(times.size):
        if not seen[r]:
            continue
        count += 1
        place = min(max((times[r] - first_time) / knot_rows, 0.0), knots - 3.000001)
        j = int(place)
        u = place - j
        w = 1.0 - u
        b0 = w * w * w / 6.0
        b1 = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
        b2 = (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / 6.0
        b3 = u * u * u / 6.0
        for e in range(dof):
            at = j * dof + e
            moved = (
                b0 * step[at]
                + b1 * step[at + dof]
                + b2 * step[at + 2 * dof]
                + b3 * step[at + 3 * dof]
            )
            total += reach[e] * moved * moved
    return total / max(count, 1)


@njit(**INLINED)
def copy_arrow(band, border, corner, to_band, to_border, to_corner):
    """Copy an arrow, by loops: slices that are assigned take a quarter of a minute to compile."""
    for j in range(band.shape[0]):
        for d in range(band.shape[1]):
            to_band[j, d] = band[j, d]
        for x in range(AHEAD):
            to_border[j, x] = border[j, x]
    for x in range(AHEAD):
        for y in range(AHEAD):
            to_corner[x, y] = corner[x, y]


@njit(**INLINED)
def next_step(
    beliefs, stiffness, control, exposure, sigma, band, border, corner, gradient, believed_band,
    believed_border, believed_corner, factor_band, factor_border, factor_corner, before, share,
    times, first_time, knot_rows, reach, seen, step,
):
    """
    Write the `step` that solves normal equations once it is `believe`d what is believed.

    The equations stay as they are; `believed_...` become those with beliefs, `factor_...` their
    factor. A step that turns back from the one `before` has gone too far, as weakly held ends of a
    frame do for ever: only a share of it is taken. Returns that share, after the last one, and how
    far the step moves the rows that are `seen`, mean square [px^2].
    """
    copy_arrow(band, border, corner, believed_band, believed_border, believed_corner)
    for j in range(step.size):
        step[j] = gradient[j]
    believe(
        beliefs, stiffness, control, exposure, sigma, believed_band, believed_border,
        believed_corner, step,
    )
    copy_arrow(
        believed_band, believed_border, believed_corner, factor_band, factor_border, factor_corner
    )
    if factorise(factor_band, factor_border, factor_corner):
        substitute(factor_band, factor_border, factor_corner, step)
    else:
        for j in range(step.size):
            step[j] = 0.0
    turned = 0.0
    for j in range(step.size):
        turned += step[j] * before[j]
    share = max(0.25, 0.5 * share) if turned < 0.0 else min(1.0, 1.5 * share)
    for j in range(step.size):
        step[j] *= share
    knots, _, dof = beliefs.bands.shape
    return share, row_steps(step, dof, times, first_time, knot_rows, knots, reach, seen)
