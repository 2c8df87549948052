"""Layers of known depth: where they are seen, what they show together, how points on them move."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS, homography, instant_offset
from .render import pose_at

TILE = 8  # px, side of the squares that are asked first which layers they may show
MIXED, SMOOTH = -1, -2  # tiles that show several layers, or one surface without an edge


@njit(**INLINED)
def parallax(q, focal, half_width, h, far, slope):
    """
    Write H at infinite depth, and how the third column of H changes with 1/d: (3,).

    H(d) = H(1) + (1/d - 1) (0 | 0 | slope): n = (0, 0, 1) multiplies the third coordinate only.
    """
    homography(q, focal, half_width, 0.0, far)
    slope[0] = h[2] - far[2]
    slope[1] = h[5] - far[5]
    slope[2] = h[8] - far[8]


@njit(**INLINED)
def deepen_columns(
    inverse_depth, h, slope, focal, half_width, g_x, g_y, column,
):
    """
    Turn derivatives of the background into those of points at other depths (d H(d) / d q).

    The centre moves a point by 1/d px a px, zoom likewise; a turn goes around where the layer's
    centre is, and a tilt moves what does not lie at the background's depth against it.
    """
    inverse_width = np.float32(1.0 / half_width)
    tilt = np.float32((focal / half_width) ** 2)
    m_x = np.float32((slope[0] - h[2] / h[8] * slope[2]) / h[8]) * inverse_width
    m_y = np.float32((slope[1] - h[5] / h[8] * slope[2]) / h[8]) * inverse_width
    for p in range(inverse_depth.size):
        near = inverse_depth[p]
        excess = near - np.float32(1.0)
        column[0, p] *= near
        column[1, p] *= near
        column[2, p] -= excess * (g_y[p] * m_x - g_x[p] * m_y)
        column[3, p] *= near
        column[4, p] -= excess * tilt * g_x[p]
        column[5, p] -= excess * tilt * g_y[p]


@njit(**INLINED)
def instants(time, exposure, count, control, first_time, knot_rows, focal, half_width, hs, slopes):
    """Write homographies (count, 9) and their `parallax` (count, 3) of one exposure."""
    q = np.zeros(6)
    far = np.empty(9)
    for k in range(count):
        pose_at(time + instant_offset(k, count) * exposure, control, first_time, knot_rows, q)
        homography(q, focal, half_width, 1.0, hs[k])
        parallax(q, focal, half_width, hs[k], far, slopes[k])


@njit(inline='always', **OPTIONS)
def place(h, slope, excess, x, y):
    """Return where a point x, y (centred) of the layer with 1/d - 1 = `excess` lies (centred)."""
    w = 1.0 / (h[6] * x + h[7] * y + h[8] + excess * slope[2])
    u = (h[0] * x + h[1] * y + h[2] + excess * slope[0]) * w
    v = (h[3] * x + h[4] * y + h[5] + excess * slope[1]) * w
    return u, v


@njit(inline='always', **OPTIONS)
def parallax_px(h, slope, x, y):
    """Return how far a step of 1 in 1/d moves a point x, y (centred) of the background [px]."""
    w = 1.0 / (h[6] * x + h[7] * y + h[8])
    u = (h[0] * x + h[1] * y + h[2]) * w
    v = (h[3] * x + h[4] * y + h[5]) * w
    return math.hypot((slope[0] - u * slope[2]) * w, (slope[1] - v * slope[2]) * w)


@njit(**OPTIONS)
def point_depths(
    first, last, rows, columns, level, times, samples, control, first_time, knot_rows, exposure,
    focal, center, layers, possible, radius, smooth, edge_step, out,
):
    """
    Write 1/d of what the points of rows[first:last] show, 0 where that is not one surface.

    `layers` (L,) 1/d, nearest first; `possible` their bits within `radius` px of a pixel, `smooth`
    (M, N) 1/d of the surface there, 0 at its edges. The nearest layer hides the others.
    """
    height, width = smooth.shape
    half_width = center[0] + 0.5
    hs = np.empty((samples.max(), 9))
    slopes = np.empty((samples.max(), 3))
    for r in range(first, last):
        count = samples[r]
        instants(
            times[r], exposure, count, control, first_time, knot_rows, focal, half_width, hs,
            slopes,
        )
        y = (rows[r] + 0.5) * level - 0.5 - center[1]
        for p in range(columns.shape[1]):
            x = (columns[r, p] + 0.5) * level - 0.5 - center[0]
            low = 1e9
            high = 0.0
            total = 0.0
            for k in range(count):
                seen = 0.0
                for n in range(layers.size):
                    u, v = place(hs[k], slopes[k], layers[n] - 1.0, x, y)
                    j = math.floor(u + center[2] + 0.5)
                    i = math.floor(v + center[3] + 0.5)
                    if i < 0 or j < 0 or i >= height or j >= width:
                        continue
                    if (possible[i + radius, j + radius] >> np.uint32(n)) & np.uint32(1):
                        seen = smooth[i, j]
                        break
                low = min(low, seen)
                high = max(high, seen)
                total += seen
                if seen == 0.0:
                    break
            out[r, p] = total / count if low > 0.0 and high - low <= edge_step else 0.0


@njit(**OPTIONS)
def ask_tiles(
    first, last, begin, duration, count, control, first_time, knot_rows, focal, center, layers,
    possible, certain, smooth, exact, radius, bits, sole,
):
    """
    Write for tiles of rows first..last which layers they may show, and which one alone.

    `sole` is that layer, `SMOOTH` where they are slices of one surface (`smooth`, not `exact`),
    else `MIXED`. `begin` and `duration` (tile rows,) [rows]: when any row of a tile is lit. A tile
    is asked at its middle; `radius` must cover half its diagonal and half the way between two
    instants.
    """
    half_width = center[0] + 0.5
    height, width = possible.shape
    hs = np.empty((count, 9))
    slopes = np.empty((count, 3))
    for i_tile in range(first, last):
        instants(
            begin[i_tile] + 0.5 * duration[i_tile], duration[i_tile], count, control, first_time,
            knot_rows, focal, half_width, hs, slopes,
        )
        y = (i_tile + 0.5) * TILE - 0.5 - center[1]
        for j_tile in range(bits.shape[1]):
            x = (j_tile + 0.5) * TILE - 0.5 - center[0]
            seen = np.uint32(0)
            alone = -9  # not asked yet
            even = not exact
            for k in range(count):
                now = -1
                for n in range(layers.size):
                    u, v = place(hs[k], slopes[k], layers[n] - 1.0, x, y)
                    j = math.floor(u + center[2] + 0.5) + radius
                    i = math.floor(v + center[3] + 0.5) + radius
                    if i < 0 or j < 0 or i >= height or j >= width:
                        continue
                    bit = np.uint32(1) << np.uint32(n)
                    if possible[i, j] & bit == 0:
                        continue
                    seen |= bit
                    even = even and smooth[i, j] > 0.0
                    if certain[i, j] & bit:
                        now = n
                        break
                alone = now if alone == -9 or alone == now else -1
            bits[i_tile, j_tile] = seen
            if even and seen != 0:
                sole[i_tile, j_tile] = SMOOTH
            elif alone >= 0 and seen == np.uint32(1) << np.uint32(alone):
                sole[i_tile, j_tile] = alone
            else:  # what is possible at one instant hides part of what is certain at another
                sole[i_tile, j_tile] = MIXED


@njit(**OPTIONS)
def composite_rows(
    first, last, bits, sole, fine, half_columns, members, near, radius, surface, uneven, layers,
    misplaced, times, samples, control, first_time, knot_rows, exposure, focal, center, out, known,
    sure,
):
    """
    Write what several layers show together, in rows first..last of the tiles that need it.

    Eq. 5: at each instant the nearest layer hides the others where it covers; `out` is the mean
    of what is seen over the part of the exposure that is `known`, the rest lies where the
    reference shows something nearer. Places between pixels are shared out bilinearly.

    An edge of the map may be `radius` px off: what is seen beside one, by `uneven` (M, N, steps of
    1/d within `radius`) or since a nearer layer is `near` (bits within `radius`), is not `sure`
    where that may move it by more than `misplaced` px. On a smooth `surface` (M, N) each place
    has its own depth.
    """
    half_width = center[0] + 0.5
    hs = np.empty((samples.max(), 9))
    slopes = np.empty((samples.max(), 3))
    found = np.empty(3, np.float32)
    for row in range(first, last):
        count = samples[row]
        prepared = False
        i_tile = row // TILE
        for column in range(out.shape[1]):
            kind = sole[i_tile, column // TILE]
            seen = bits[i_tile, column // TILE]
            if kind >= 0 or seen == 0:
                continue
            if not prepared:
                instants(
                    times[row], exposure, count, control, first_time, knot_rows, focal, half_width,
                    hs, slopes,
                )
                prepared = True
            x = column - center[0]
            y = row - center[1]
            if kind == SMOOTH:
                add_surface(
                    hs, slopes, count, x, y, center, fine, half_columns, surface, found,
                )
            else:
                add_layers(
                    hs, slopes, count, x, y, center, fine, half_columns, members, near, radius,
                    uneven, layers, seen, misplaced, found,
                )
            covered = found[1]
            out[row, column] = found[0] / covered if covered > 0.0 else np.float32(0.0)
            known[row, column] = covered / np.float32(count)
            sure[row, column] = found[2] / np.float32(count)


@njit(**INLINED)
def add_surface(hs, slopes, count, x, y, center, fine, half_columns, surface, found):
    """Write light, covered and trusted instants of a pixel x, y (centred) of one smooth surface."""
    u_limit = surface.shape[1] - 1.0
    v_limit = surface.shape[0] - 1.0
    light = np.float32(0.0)
    covered = np.float32(0.0)
    excess = np.float32(0.0)
    settle = 3  # then the place of one instant tells the depth of the next
    for k in range(-settle, count):
        u, v = place(hs[max(k, 0)], slopes[max(k, 0)], excess, x, y)
        u += center[2]
        v += center[3]
        j = int(min(max(u, 0.0), u_limit) + 0.5)
        i = int(min(max(v, 0.0), v_limit) + 0.5)
        excess = surface[i, j] - np.float32(1.0)
        if k >= 0 and u >= 0.0 and v >= 0.0 and u <= u_limit and v <= v_limit:
            light += half_pixel_value(fine, half_columns, u, v, u_limit, v_limit)
            covered += np.float32(1.0)
    found[0] = light
    found[1] = covered
    found[2] = covered


@njit(**INLINED)
def add_layers(
    hs, slopes, count, x, y, center, fine, half_columns, members, near, radius, uneven, layers,
    seen, misplaced, found,
):
    """Write light, covered and trusted instants of a pixel x, y (centred), nearest layer first."""
    u_limit = members.shape[1] - 1.0
    v_limit = members.shape[0] - 1.0
    light = np.float32(0.0)
    covered = np.float32(0.0)
    trusted = np.float32(0.0)
    for k in range(count):
        h = hs[k]
        slope = slopes[k]
        top = h[0] * x + h[1] * y + h[2]
        side = h[3] * x + h[4] * y + h[5]
        scale = h[6] * x + h[7] * y + h[8]
        left = np.float32(1.0)
        beside = 0.0  # 1/d of the nearest layer that may hide what is seen, and does not
        rest = seen
        n = 0
        while rest != 0 and left > np.float32(1e-4):
            if rest & np.uint32(1):
                excess = layers[n] - 1.0
                w = 1.0 / (scale + excess * slope[2])
                u = (top + excess * slope[0]) * w + center[2]
                v = (side + excess * slope[1]) * w + center[3]
                if u >= 0.0 and v >= 0.0 and u <= u_limit and v <= v_limit:
                    share = cover(members, n, u, v)
                    i = int(v + 0.5)
                    j = int(u + 0.5)
                    perhaps = (near[i + radius, j + radius] >> np.uint32(n)) & np.uint32(1)
                    if perhaps and beside == 0.0 and share < np.float32(1.0):
                        beside = layers[n]
                    share = min(share, left)
                    if share > 0.0:
                        light += share * half_pixel_value(
                            fine, half_columns, u, v, u_limit, v_limit
                        )
                        covered += share
                        left -= share
                        step = max(uneven[i, j], beside - layers[n])
                        if step <= 0.0 or step * parallax_px(h, slope, x, y) <= misplaced:
                            trusted += share
            rest = rest >> np.uint32(1)
            n += 1
    found[0] = light
    found[1] = covered
    found[2] = trusted


@njit(inline='always', **OPTIONS)
def cover(members, n, u, v):
    """Return how much of the place u, v belongs to layer n, 0..1, bilinearly."""
    i = min(int(v), members.shape[0] - 2)
    j = min(int(u), members.shape[1] - 2)
    a = np.float32(v - i)
    b = np.float32(u - j)
    one = np.float32(1.0)
    bit = np.uint32(n)
    m00 = np.float32((members[i, j] >> bit) & np.uint32(1))
    m01 = np.float32((members[i, j + 1] >> bit) & np.uint32(1))
    m10 = np.float32((members[i + 1, j] >> bit) & np.uint32(1))
    m11 = np.float32((members[i + 1, j + 1] >> bit) & np.uint32(1))
    return (one - a) * ((one - b) * m00 + b * m01) + a * ((one - b) * m10 + b * m11)


@njit(inline='always', **OPTIONS)
def half_pixel_value(fine, half_columns, u, v, u_limit, v_limit):
    """Return the half-pixel reference (flat) at u, v [px]."""
    i = min(int(2.0 * v), int(2.0 * v_limit) - 1)
    j = min(int(2.0 * u), int(2.0 * u_limit) - 1)
    a = np.float32(2.0 * v - i)
    b = np.float32(2.0 * u - j)
    at = i * half_columns + j
    top = fine[at] + b * (fine[at + 1] - fine[at])
    at += half_columns
    return top + a * (fine[at] + b * (fine[at + 1] - fine[at]) - top)
