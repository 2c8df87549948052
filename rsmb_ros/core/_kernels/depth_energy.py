"""How well one relative depth or another explains a part of a live frame."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS, homography, instant_offset
from .render import add_instant, keep_complete, pose_at

MOST_INSTANTS = 96
ROUNDED = 1.0 + 1e-9  # more than sums are off by
POSE = 12  # numbers of a pose: H at infinite depth (9), and how its third column grows with 1/d


@njit(**OPTIONS)
def pose_table(first, spacing, control, first_time, knot_rows, focal, half_width, out):
    """Write H at infinite depth and its slope over 1/d, (T, 12), at times first + n spacing."""
    q = np.zeros(6)
    h = np.empty(9)
    for n in range(out.shape[0]):
        pose_at(first + n * spacing, control, first_time, knot_rows, q)
        homography(q, focal, half_width, 0.0, h)
        for e in range(9):
            out[n, e] = h[e]
        homography(q, focal, half_width, 1.0, h)
        for e in range(3):
            out[n, 9 + e] = h[3 * e + 2] - out[n, 3 * e + 2]


@njit(**INLINED)
def pose_between(poses, place, inverse_depth, h):
    """Write H at 1/d = `inverse_depth`, `place` spacings after the first of `poses`."""
    n = max(0, min(int(place), poses.shape[0] - 2))
    part = place - n
    for e in range(9):
        h[e] = poses[n, e] + part * (poses[n + 1, e] - poses[n, e])
    for e in range(3):
        slope = poses[n, 9 + e] + part * (poses[n + 1, 9 + e] - poses[n, 9 + e])
        h[3 * e + 2] += inverse_depth * slope


@njit(**INLINED)
def blur_row(
    y, left, right, fine, half_rows, half_columns, place, extent, count, poses, inverse_depth,
    center, h, out,
):
    """
    Write the mean of the warped reference over one row's exposure (Eq. 1) to out[:right - left].

    The row, `y` from the centre, is lit around `place` for `extent`, both in spacings of `poses`.
    Returns the columns begin, end in which it is complete; it is 0 outside.
    """
    lo = left
    hi = right
    share = np.float32(1.0 / count)
    out[: right - left] = 0.0
    for k in range(count):
        pose_between(poses, place + instant_offset(k, count) * extent, inverse_depth, h)
        lo, hi = add_instant(
            h, y, left, lo, hi, fine, half_rows, half_columns, 1, None, share, center, out, 0
        )
        if lo >= hi:
            break
    return keep_complete(lo, hi, left, right, 1, out, 0)


@njit(**INLINED)
def misfit_of_row(light, gain, bias, curve, live, weight, begin, end, most):
    """
    Return the sum of min((live - predicted)^2 weight, most) over a row.

    `light` (n,) linear, `curve` its display values over the root of its share of 255; columns
    outside [begin, end) are not shown and take `most` where `weight` > 0.
    """
    last = np.float32(curve.size - 1.001)  # between the last two
    scale = np.float32((curve.size - 1.0) / math.sqrt(255.0))
    most = np.float32(most)
    total = np.float32(0.0)
    for x in range(begin, end):
        linear = max(light[x] * gain[x] + bias, np.float32(0.0))
        at = min(np.float32(math.sqrt(linear)) * scale, last)
        n = np.uint32(np.int32(at))
        part = at - np.float32(np.int32(at))
        low = curve[n]
        off = live[x] - low - part * (curve[n + np.uint32(1)] - low)
        total += min(off * off * weight[x], most)
    for x in range(begin):
        if weight[x] > 0.0:
            total += most
    for x in range(end, weight.size):
        if weight[x] > 0.0:
            total += most
    return total


@njit(**INLINED)
def energy(
    inverse_depth, stride, step, top, left, live, weight, extents, fine, half_rows, half_columns,
    places, extent, counts, poses, center, gain, bias, curve, most, least, h, light, field,
):
    """
    Return the mean of min(z^2, most) over every `stride`-th row of a window at one depth.

    One that is sure to be `least` or more is not looked at to the end.
    """
    total = 0.0
    known = 0
    for r in range(stride // 2, live.shape[0], stride):
        known += extents[r, 2]
    known = max(known, 1)
    enough = least * known * ROUNDED
    half = center[0] + 0.5
    for r in range(stride // 2, live.shape[0], stride):
        begin = extents[r, 0]
        end = extents[r, 1]
        if end <= begin:
            continue
        if total > enough:
            break
        count = math.ceil((counts[r] - 1) * max(1.0, inverse_depth) / step) + 1
        y = top + r - center[1]
        lo, hi = blur_row(
            y, left + begin, left + end, fine, half_rows, half_columns, places[r], extent,
            max(2, min(count, MOST_INSTANTS)), poses, inverse_depth, center, h, light,
        )
        v = np.float32(y / half)
        first = np.float32((left + begin - center[0]) / half)
        further = np.float32(1.0 / half)
        for x in range(end - begin):
            u = first + np.float32(x) * further
            field[x] = gain[0] + gain[1] * u + gain[2] * v + gain[3] * (u * u + v * v)
        total += misfit_of_row(
            light, field, bias, curve, live[r, begin:end], weight[r, begin:end],
            lo - left - begin, hi - left - begin, most,
        )
    return total / known


@njit(**OPTIONS)
def best_depth(
    depths, apart, steps, least_move, reach, strides, spacings, top, left, live, weight, extents,
    fine, half_rows, half_columns, places, extent, counts, poses, center, gain, bias, curve, most,
    found,
):
    """
    Write the depth of least energy, that energy, and the energy at the background's depth.

    `depths` that move the object by `apart` px or more from the one before are compared first, on
    every strides[0]-th row of the window with instants every spacings[0] px; then `steps` to both
    sides of the best on every strides[1]-th, every spacings[1] px, down to those that move it by
    `least_move` px. `reach` is how far 1 in 1/d moves it [px].

    `live` and `weight`, 1 / sigma^2 of what is asked and 0 elsewhere, are the window's, which is
    at `top` and `left` of the frame; `extents` holds each row's first, last (exclusive) and number
    of asked pixels, `places` and `extent` its exposure in spacings of `poses`, `counts` its
    instants if they are 1 px apart.
    """
    h = np.empty(9)
    light = np.empty(live.shape[1], np.float32)
    field = np.empty(live.shape[1], np.float32)
    best = depths[0]
    unknown = 2.0 * most  # no energy is as large
    least = unknown
    middle = best
    before = np.inf
    for n in range(depths.size + 2 + 2 * steps.size):
        stage = n - depths.size
        fully = 0 if stage < 0 else 1
        depth = best
        if stage < 0:
            depth = depths[n]
            if abs(1.0 / depth - before) * reach < apart:
                continue
            before = 1.0 / depth
        elif stage == 0:
            depth = 1.0
        elif stage == 1:
            least = unknown  # on more pixels it is another
        else:
            step = steps[stage // 2 - 1]
            if stage % 2 == 0:
                middle = best
                step = -step
            if abs(step) * reach < least_move * middle * middle:
                continue
            depth = middle + step
        value = energy(
            1.0 / depth, strides[fully], spacings[fully], top, left, live, weight, extents, fine,
            half_rows, half_columns, places, extent, counts, poses, center, gain, bias, curve,
            most, unknown if stage == 0 else least, h, light, field,
        )
        if stage == 0:
            found[2] = value
        elif value < least:
            least = value
            best = depth
    found[0] = best
    found[1] = least
