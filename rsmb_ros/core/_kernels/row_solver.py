"""
The Huber problem of one row over w >= 0 (Eq. 10 after chi): active set and semismooth Newton.

Sums stand in loops that store nothing: beside a store they are vectorised in one way or another,
by where the arrays happen to lie, and equal inputs would give results that differ in the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

MOST_ACTIVE = 96  # poses with weight at a time; a row ends with 5 to 20
MOST_EXCHANGES = 400  # times that poses enter
MOST_STEPS = 60  # Newton steps between two of them
ENTERING = 2  # poses that enter at a time
SEARCHES = 12  # places tried along one step
LEAST_DAMPING = 1e-3  # weight of pixels beyond delta in a Newton step, against IRLS
RIDGE = 1e-11  # of the mean diagonal; keeps equal columns apart


@njit(**INLINED)
def huber_cost(residual, delta):
    """Return sum of r^2 / 2 where |r| <= delta, else delta |r| - delta^2 / 2."""
    total = 0.0
    for x in range(residual.size):
        a = abs(residual[x])
        inner = min(a, delta)
        total += inner * (a - 0.5 * inner)
    return total


@njit(inline='always', **OPTIONS)
def _dot(matrix, k, vector):
    total = 0.0
    for x in range(vector.size):
        total += matrix[k, x] * vector[x]
    return total


@njit(inline='always', **OPTIONS)
def _weighted_dot(matrix, k, m, weight):
    total = 0.0
    for x in range(weight.size):
        total += matrix[k, x] * matrix[m, x] * weight[x]
    return total


@njit(**INLINED)
def _slope_along(residual, move, t, delta):
    """Return minus the slope of the Huber cost of r - t move, without the l1 term."""
    total = 0.0
    for x in range(residual.size):
        total += min(max(residual[x] - t * move[x], -delta), delta) * move[x]
    return total


@njit(**INLINED)
def _length_along(residual, move, step_sum, lambda_1, longest, delta):
    """Return where in (0, longest] the cost is least along a descent direction."""
    high = longest
    rise = lambda_1 * step_sum
    at_high = rise - _slope_along(residual, move, high, delta)
    if at_high <= 0.0:
        return high
    low = 0.0
    at_low = rise - _slope_along(residual, move, 0.0, delta)
    small = 1e-9 * abs(at_low)
    for _ in range(SEARCHES):
        # the slope is piecewise linear and rising: secant, kept off the ends
        t = low + (high - low) * min(max(at_low / (at_low - at_high), 0.02), 0.98)
        now = rise - _slope_along(residual, move, t, delta)
        if abs(now) <= small:
            return t
        if now > 0.0:
            high = t
            at_high = now
        else:
            low = t
            at_low = now
    return low if low > 0.0 else high


@njit(**INLINED)
def _solve_spd(matrix, size, vector):
    """Solve in place with the lower triangle of `matrix`; dependent unknowns do not move."""
    mean = 0.0
    for p in range(size):
        mean += matrix[p, p]
    ridge = RIDGE * mean / size + 1e-12
    for p in range(size):
        for m in range(p + 1):
            total = matrix[p, m]
            for j in range(m):
                total -= matrix[p, j] * matrix[m, j]
            if p == m:
                matrix[p, p] = math.sqrt(total + ridge) if total > -0.5 * ridge else 1e150
            else:
                matrix[p, m] = total / matrix[m, m]
    for p in range(size):
        total = vector[p]
        for j in range(p):
            total -= matrix[p, j] * vector[j]
        vector[p] = total / matrix[p, p]
    for p in range(size - 1, -1, -1):
        total = vector[p]
        for j in range(p + 1, size):
            total -= matrix[j, p] * vector[j]
        vector[p] = total / matrix[p, p]


@njit(**INLINED)
def _residual(live, design, share, used, out):
    """Write r = g - F w over the poses in use."""
    for x in range(live.size):
        out[x] = live[x]
    for p in range(used):
        for x in range(live.size):
            out[x] -= share[p] * design[p, x]


@njit(**INLINED)
def _leave(p, used, active, design, share):
    """Take pose number `p` of those in use out; return how many are left."""
    last = used - 1
    active[p] = active[last]
    share[p] = share[last]
    for x in range(design.shape[1]):
        design[p, x] = design[last, x]
    return last


@njit(**INLINED)
def _settle(used, active, design, share, residual, lambda_1, delta, small, psi, weight, move):
    """
    Minimise over the poses in use, w >= 0, by semismooth Newton steps; return how many are left.

    A step stops where a weight reaches 0; that pose leaves. The first step is one of IRLS, later
    ones count the pixels beyond delta, where the Huber cost has no curvature, less and less.
    """
    n = residual.size
    normal = np.empty((used, used))
    step = np.empty(used)
    damping = 1.0
    for _ in range(MOST_STEPS):
        if used == 0:
            return 0
        for x in range(n):
            psi[x] = min(max(residual[x], -delta), delta)
        worst = 0.0
        for p in range(used):
            step[p] = _dot(design, p, psi) - lambda_1
            worst = max(worst, abs(step[p]))
        if worst <= small:
            return used
        for x in range(n):
            a = abs(residual[x])
            weight[x] = 1.0 if a <= delta else damping * delta / a
        damping = max(0.1 * damping, LEAST_DAMPING)
        for p in range(used):
            for m in range(p + 1):
                normal[p, m] = _weighted_dot(design, p, m, weight)
        _solve_spd(normal, used, step)
        longest = 1.0
        blocked = -1
        for p in range(used):
            if share[p] + longest * step[p] < 0.0:
                longest = -share[p] / step[p]
                blocked = p
        if longest > 0.0:
            for x in range(n):
                move[x] = 0.0
            step_sum = 0.0
            for p in range(used):
                step_sum += step[p]
            for p in range(used):
                for x in range(n):
                    move[x] += step[p] * design[p, x]
            t = _length_along(residual, move, step_sum, lambda_1, longest, delta)
            if t < longest:
                blocked = -1
            for p in range(used):
                share[p] = max(share[p] + t * step[p], 0.0)
            for x in range(n):
                residual[x] -= t * move[x]
        if blocked >= 0:
            used = _leave(blocked, used, active, design, share)
    return used


@njit(**OPTIONS)
def solve_active_set(columns, live, lambda_1, delta, tolerance, weights, residual):
    """
    Minimise huber(g - F w) + lambda_1 sum(w) over w >= 0 (Eq. 10 after chi).

    `columns` (K, n) float32 holds F transposed; `weights` (K,) the start on entry, the solution on
    return; `residual` (n,) receives g - F w. Ends when no pose's slope, times the sum of weights,
    could lower the cost by more than `tolerance` of it. Returns how often poses entered.
    """
    count, n = columns.shape
    most = min(count, MOST_ACTIVE)
    active = np.empty(most, np.int64)
    design = np.empty((most, n))
    share = np.empty(most)
    psi = np.empty(n)
    weight = np.empty(n)
    move = np.empty(n)
    pull = np.empty(count)
    used = 0
    for k in range(count):
        if weights[k] > 0.0 and used < most:
            active[used] = k
            share[used] = weights[k]
            for x in range(n):
                design[used, x] = columns[k, x]
            used += 1
    exchanges = 0
    small = 1e-3 * lambda_1
    while True:
        _residual(live, design, share, used, residual)
        total = 0.0
        for p in range(used):
            total += share[p]
        cost = huber_cost(residual, delta) + lambda_1 * total
        small = tolerance * cost / max(1.0, total)
        used = _settle(
            used, active, design, share, residual, lambda_1, delta, 0.3 * small, psi, weight, move
        )
        if exchanges == MOST_EXCHANGES:
            break
        for x in range(n):
            psi[x] = min(max(residual[x], -delta), delta)
        for k in range(count):
            pull[k] = _dot(columns, k, psi) - lambda_1
        for p in range(used):
            pull[active[p]] = 0.0
        entered = 0
        while entered < ENTERING and used < most:
            best = -1
            highest = small
            for k in range(count):
                if pull[k] > highest:
                    highest = pull[k]
                    best = k
            if best < 0:
                break
            pull[best] = 0.0
            active[used] = best
            share[used] = 0.0
            for x in range(n):
                design[used, x] = columns[best, x]
            used += 1
            entered += 1
        if entered == 0:
            break
        exchanges += 1
    for k in range(count):
        weights[k] = 0.0
    for p in range(used):
        weights[active[p]] = share[p]
    _residual(live, design, share, used, residual)
    return exchanges
