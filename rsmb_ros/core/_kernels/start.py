"""Normal equations of the start path: four coordinates of a spline through matched pieces."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .fit_row import AHEAD
from .geometry import INLINED, OPTIONS, span
from .normal import factorise, substitute

COORDINATES = 4  # offset x, y, and rotation and zoom as s sin(r), s cos(r) - 1


@njit(**OPTIONS)
def mean_weights(times, count, exposure, first_time, knot_rows, knots, first, weights):
    """
    Write the weights of control points in the mean path over the exposure around each time (n,).

    `count` instants stand for an exposure; weights[n] (W) are those of the knots from first[n] on.
    """
    for n in range(times.size):
        weights[n] = 0.0
        first[n], _ = span(times[n] + (0.5 / count - 0.5) * exposure, first_time, knot_rows, knots)
        for k in range(count):
            time = times[n] + ((k + 0.5) / count - 0.5) * exposure
            j, u = span(time, first_time, knot_rows, knots)
            v = 1.0 - u
            to = j - first[n]
            weights[n, to] += v * v * v / (6.0 * count)
            weights[n, to + 1] += (3.0 * u * u * u - 6.0 * u * u + 4.0) / (6.0 * count)
            weights[n, to + 2] += (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / (6.0 * count)
            weights[n, to + 3] += u * u * u / (6.0 * count)


@njit(**INLINED)
def add_row(own, row, begin, band, to, count):
    """Add `own` times row[begin:] to row `to` of a band."""
    begin = np.uint64(begin)
    for k in range(np.uint64(count)):
        band[to, k] += own * row[begin + k]


@njit(**INLINED)
def add_pieces(first, weights, places, shifts, trust, band, gradient):
    """
    Add what matched pieces say to the band (D, W) and the gradient of the normal equations.

    Pieces at `places` (n, 2) [half widths] are moved by `shifts` (n, 2) [px]; `trust` (n, 2).
    Knot k holds the unknowns 4 k .. 4 k + 3.
    """
    unknowns = band.shape[0]
    row = np.empty(weights.shape[1] * COORDINATES)
    for n in range(first.size):
        x = places[n, 0]
        y = places[n, 1]
        at = first[n] * COORDINATES
        size = min(row.size, unknowns - at)
        for axis in range(2):
            # x moves by a_x - y s + x c, y by a_y + x s + y c
            for i in range(weights.shape[1]):
                row[COORDINATES * i] = weights[n, i] * (1 - axis)
                row[COORDINATES * i + 1] = weights[n, i] * axis
                row[COORDINATES * i + 2] = weights[n, i] * (x if axis else -y)
                row[COORDINATES * i + 3] = weights[n, i] * (y if axis else x)
            for i in range(size):
                own = row[i] * trust[n, axis]
                gradient[at + i] += own * shifts[n, axis]
                add_row(own, row, i, band, at + i, size - i)


@njit(**INLINED)
def misfits(first, weights, places, shifts, solution, out):
    """Write how far the pieces lie from where a solution (D,) puts them (n,) [px]."""
    knots = solution.size // COORDINATES
    for n in range(first.size):
        a_x = 0.0
        a_y = 0.0
        turn = 0.0
        grow = 0.0
        for i in range(min(weights.shape[1], knots - first[n])):
            at = (first[n] + i) * COORDINATES
            a_x += weights[n, i] * solution[at]
            a_y += weights[n, i] * solution[at + 1]
            turn += weights[n, i] * solution[at + 2]
            grow += weights[n, i] * solution[at + 3]
        x = places[n, 0]
        y = places[n, 1]
        off_x = shifts[n, 0] - (a_x - y * turn + x * grow)
        off_y = shifts[n, 1] - (a_y + x * turn + y * grow)
        out[n] = math.hypot(off_x, off_y)


@njit(**OPTIONS)
def laid_through(first, weights, places, shifts, given, prior, rounds, least, solution):
    """
    Write the `solution` (D + AHEAD,) of the robust least squares of matched pieces, the path first.

    `given` (n, 2) is the trust at first, `prior` (D, W) the band of what is believed; pieces that
    misfit by more than twice the usual, at `least` px, are then trusted less, in some `rounds`.
    """
    unknowns = prior.shape[0]
    band = np.empty_like(prior)
    border = np.zeros((unknowns, AHEAD))
    corner = np.empty((AHEAD, AHEAD))
    misfit = np.empty(first.size)
    trust = given.copy()
    for _ in range(rounds):
        band[:] = prior
        solution[:] = 0.0
        add_pieces(first, weights, places, shifts, trust, band, solution)
        # no extra unknowns: the factor of nothing is 1
        border[:] = 0.0
        corner[:] = 0.0
        for x in range(AHEAD):
            corner[x, x] = 1.0
        if factorise(band, border, corner):
            substitute(band, border, corner, solution)
        else:
            solution[:] = 0.0
        misfits(first, weights, places, shifts, solution[:unknowns], misfit)
        sigma = max(least, 1.4826 * np.median(misfit))
        for n in range(first.size):
            far = misfit[n] / (2.0 * sigma)
            share = 1.0 / ((1.0 + far * far) * (1.0 + far * far))
            trust[n, 0] = given[n, 0] * share
            trust[n, 1] = given[n, 1] * share
