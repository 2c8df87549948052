"""Images from a known path."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .display import show_row
from .geometry import INLINED, OPTIONS, homography, instant, instant_offset

BENT = 0.003  # px, largest error of places along a piece of a row
STRAIGHT = 0.01  # of a cell, by which a run may leave it


@njit(inline='always', **OPTIONS)
def half_place(h, a0, b0, c0, x, center):
    """Return where pixel `x` of a live row lies in the reference [half pixels]."""
    xc = x - center[0]
    w = 1.0 / (c0 + h[6] * xc)
    u = (a0 + 2.0 * h[0] * xc) * w + 2.0 * center[2]
    v = (b0 + 2.0 * h[3] * xc) * w + 2.0 * center[3]
    return u, v


@njit(**INLINED)
def pose_at(time, control, first_time, knot_rows, q):
    """Write the path coordinates at `time` into `q`."""
    instant(time, control, first_time, knot_rows, np.empty(4), q)


@njit(inline='always', **OPTIONS)
def cells(fraction, slope):
    """Return how many steps of `slope` a `fraction` of a cell takes to leave its cell."""
    ahead = 1.0 - fraction if slope > 0.0 else fraction
    return ahead / (abs(slope) + 1e-9)


@njit(**INLINED)
def add_run(fine, at, stride, f_u, s_u, c_u, f_v, s_v, c_v, share, out, to, count):
    """
    Add `share` of the reference, read along a row from cell `at` on, to out[to:], both flat.

    Step k is 2k half pixels further on and adds k (s + k c) to the fractions f: no index
    arithmetic, all loads in order. This loop is where rendering spends its time.
    """
    f_u = np.float32(f_u)
    f_v = np.float32(f_v)
    s_u = np.float32(s_u)
    s_v = np.float32(s_v)
    c_u = np.float32(c_u)
    c_v = np.float32(c_v)
    # unsigned: numba would check each signed index for wrapping around, and not vectorise
    at = np.uint64(at)
    to = np.uint64(to)
    below = at + np.uint64(stride)
    one = np.uint64(1)
    for k in range(np.uint64(count)):
        n = k + k
        step = np.float32(np.int32(k))
        u = f_u + step * (s_u + step * c_u)
        v = f_v + step * (s_v + step * c_v)
        left = fine[at + n]
        top = left + u * (fine[at + n + one] - left)
        left = fine[below + n]
        bottom = left + u * (fine[below + n + one] - left)
        out[to + k] += (top + v * (bottom - top)) * share


@njit(**INLINED)
def add_colours(
    fine, left, right, stride, pixel, f_u, s_u, c_u, f_v, s_v, c_v, share, out, to, count
):
    """
    Do what `add_run` does for all `count` values of a run of colours, as they lie side by side.

    What is left and right of the places begins at `left` and at `right`: columns of either half
    pixel lie together, so that neighbours in the image are neighbours in memory. `pixel` holds
    which pixel of the run a value belongs to.
    """
    f_u = np.float32(f_u)
    f_v = np.float32(f_v)
    s_u = np.float32(s_u)
    s_v = np.float32(s_v)
    c_u = np.float32(c_u)
    c_v = np.float32(c_v)
    left = np.uint64(left)
    right = np.uint64(right)
    stride = np.uint64(stride)
    to = np.uint64(to)
    for k in range(np.uint64(count)):
        u = f_u + pixel[k] * (s_u + pixel[k] * c_u)
        v = f_v + pixel[k] * (s_v + pixel[k] * c_v)
        one = fine[left + k]
        top = one + u * (fine[right + k] - one)
        one = fine[left + stride + k]
        bottom = one + u * (fine[right + stride + k] - one)
        out[to + k] += (top + v * (bottom - top)) * share


@njit(inline='always', **OPTIONS)
def inside_of(h, a0, b0, c0, x, center, u_limit, v_limit):
    """Say whether pixel `x` of a live row lies in the reference."""
    u, v = half_place(h, a0, b0, c0, x, center)
    return 0.0 <= u <= u_limit and 0.0 <= v <= v_limit


@njit(inline='always', **OPTIONS)
def piece_of(h, width):
    """Return over how many px of `width` a parabola may stand for the places of a row."""
    # it is off by |third derivative| piece^3 / 125
    bend = 6.0 * h[6] * h[6] + 1e-15
    whole = float(width)
    if bend * whole * whole * whole <= BENT * 125.0:
        return width
    return max(2, int((BENT * 125.0 / bend) ** (1.0 / 3.0)))


@njit(**INLINED)
def add_instant(
    h, y, left, lo, hi, fine, half_rows, half_columns, colours, pixel, share, center, sums, to
):
    """
    Add `share` of the reference, as homography `h` shows it in the row `y` from the centre.

    Columns lo..hi of the row that begins at column `left`, into sums[to:], flat. Returns those of
    them that lie in the reference; the sums of others are not complete. Places are parabolas over
    pieces so short that they are off by `BENT` px at most. With several colours `fine` is a
    `sampling.side_by_side` image; where `pixel` is None, it is `sampling.half_pixel`, and what
    colours need is not compiled: it would slow down one colour by half.
    """
    u_limit = half_columns - 2.0
    v_limit = half_rows - 2.0
    columns = half_columns // 2
    a0 = 2.0 * (h[1] * y + h[2])
    b0 = 2.0 * (h[4] * y + h[5])
    c0 = h[7] * y + h[8]
    while lo < hi and not inside_of(h, a0, b0, c0, lo, center, u_limit, v_limit):
        lo += 1
    while lo < hi and not inside_of(h, a0, b0, c0, hi - 1, center, u_limit, v_limit):
        hi -= 1
    piece = piece_of(h, hi - lo)
    begin = lo
    u, v = half_place(h, a0, b0, c0, begin, center)
    while begin < hi:
        end = min(begin + piece, hi)
        g = 0.5 * (end - begin)
        u_mid, v_mid = half_place(h, a0, b0, c0, begin + g, center)
        u_end, v_end = half_place(h, a0, b0, c0, end, center)
        c_u = 0.5 * (u_end - 2.0 * u_mid + u) / (g * g)
        c_v = 0.5 * (v_end - 2.0 * v_mid + v) / (g * g)
        s_u = (u_mid - u) / g - c_u * g - 2.0
        s_v = (v_mid - v) / g - c_v * g
        # over so many pixels a parabola is so nearly straight that the slope between its ends
        # tells where it leaves a cell
        straight = min(math.sqrt(4.0 * STRAIGHT / (max(abs(c_u), abs(c_v)) + 1e-12)), 1e5) + 1.0
        x = begin
        while x < end:
            d = x - begin
            u_x = u + d * (s_u + 2.0 + d * c_u)
            v_x = v + d * (s_v + d * c_v)
            # the last sample of a row or column has no right neighbour: step back one
            iu = max(0, min(int(u_x), half_columns - 2))
            iv = max(0, min(int(v_x), half_rows - 2))
            f_u = u_x - iu
            f_v = v_x - iv
            in_u = cells(f_u, s_u + c_u * (2.0 * d + straight))
            in_v = cells(f_v, s_v + c_v * (2.0 * d + straight))
            run = min(end - x, int(min(straight, in_u, in_v)) + 1)
            # the run must end before its row of cells does
            run = min(run, (half_columns - 2 - iu) // 2 + 1)
            t_u = s_u + 2.0 * c_u * d
            t_v = s_v + 2.0 * c_v * d
            if pixel is None:
                add_run(
                    fine, iv * half_columns + iu, half_columns, f_u, t_u, c_u, f_v, t_v, c_v,
                    share, sums, to + x - left, run,
                )
            else:
                odd = iu & 1
                own = iv * half_columns + odd * columns + (iu >> 1)
                after = iv * half_columns + (1 - odd) * columns + ((iu + 1) >> 1)
                add_colours(
                    fine, own * colours, after * colours, half_columns * colours, pixel, f_u,
                    t_u, c_u, f_v, t_v, c_v, share, sums, to + (x - left) * colours,
                    run * colours,
                )
            x += run
        begin = end
        u = u_end
        v = v_end
    return lo, hi


@njit(**INLINED)
def keep_complete(lo, hi, left, right, colours, sums, to):
    """Set what is not complete of a row's sums to 0; return its complete columns."""
    if lo >= hi:
        lo = left
        hi = left
    sums[to : to + (lo - left) * colours] = 0.0
    sums[to + (hi - left) * colours : to + (right - left) * colours] = 0.0
    return lo, hi


@njit(**INLINED)
def blur_row(
    i, left, right, fine, half_rows, half_columns, colours, pixel, time, count, control, first_time,
    knot_rows, exposure, focal, center, inverse_depth, b, q, h, sums, to,
):
    """
    Write the mean of the warped reference over the exposure of row `i` (Eq. 1) to sums[to:], flat.

    Columns left..right of the live frame. Returns between which the row is complete, outside it is
    0. See `add_instant`.
    """
    half_width = center[0] + 0.5
    share = np.float32(1.0 / count)
    lo = left
    hi = right
    sums[to : to + (right - left) * colours] = 0.0
    for k in range(count):
        instant(time + instant_offset(k, count) * exposure, control, first_time, knot_rows, b, q)
        homography(q, focal, half_width, inverse_depth, h)
        lo, hi = add_instant(
            h, i - center[1], left, lo, hi, fine, half_rows, half_columns, colours, pixel, share,
            center, sums, to,
        )
        if lo >= hi:
            break
    return keep_complete(lo, hi, left, right, colours, sums, to)


@njit(**OPTIONS)
def blur_rows(
    first, last, top, left, right, fine, half_rows, half_columns, times, samples, control,
    first_time, knot_rows, exposure, focal, center, inverse_depth, out, complete,
):
    """
    Write the mean of the warped reference over each row's exposure for one layer, see `blur_row`.

    Rows first..last of the live frame; `out` and `complete` begin at row `top` and column `left`.
    """
    b = np.empty(4)
    h = np.empty(9)
    q = np.zeros(6)
    width = right - left
    sums = out.reshape(-1)
    for i in range(first, last):
        lo, hi = blur_row(
            i, left, right, fine, half_rows, half_columns, 1, None, times[i], samples[i], control,
            first_time, knot_rows, exposure, focal, center, inverse_depth, b, q, h, sums,
            (i - top) * width,
        )
        complete[i - top] = False
        complete[i - top, lo - left : hi - left] = True


@njit(**OPTIONS)
def show_rows(
    first, last, top, left, right, fine, half_rows, half_columns, times, samples, control,
    first_time, knot_rows, exposure, focal, center, inverse_depth, pixel, gain, bias, gamma,
    weights, grey, shown, complete,
):
    """
    Write display values of what `blur_rows` finds, in other light, see `display.show_row`.

    `shown` (rows, columns * colours) is 0 where a row is not complete.
    """
    b = np.empty(4)
    h = np.empty(9)
    q = np.zeros(6)
    width = right - left
    colours = weights.size
    sums = np.empty(width * colours, np.float32)
    for i in range(first, last):
        lo, hi = blur_row(
            i, left, right, fine, half_rows, half_columns, colours, pixel, times[i], samples[i],
            control, first_time, knot_rows, exposure, focal, center, inverse_depth, b, q, h, sums,
            0,
        )
        n = i - top
        show_row(
            sums, pixel, left - center[0], i - center[1], center[0] + 0.5, gain, bias,
            gamma, weights, grey[n], shown[n],
        )
        shown[n, : (lo - left) * colours] = 0
        shown[n, (hi - left) * colours :] = 0
        complete[n] = False
        complete[n, lo - left : hi - left] = True


@njit(**OPTIONS)
def live_places(first, last, inverses, center, rows, surface, shifts, map_x, map_y):
    """
    Write, for reference pixels of rows first..last, where the live frame shows them.

    `inverses` (M, 9) holds the inverse homography of each live row's centroid pose. The row is
    found by fixed-point iteration between whole rows; places may lie outside the frame. `surface`
    (M, N) is 1/d of the reference, None: 1 everywhere; `shifts` (M, 3) the inverses times the
    slope of the homographies over 1/d, `depth.parallax`.
    """
    for v in range(first, last):
        vc = v - center[3]
        y = vc + center[1]
        for u in range(map_x.shape[1]):
            uc = u - center[2]
            x = 0.0
            for _ in range(12):
                at = min(max(y, 0.0), rows - 1.000001)
                i = int(at)
                part = at - i
                g = inverses[i]
                n = inverses[i + 1]
                w = 1.0 / (g[6] * uc + g[7] * vc + g[8])
                w1 = 1.0 / (n[6] * uc + n[7] * vc + n[8])
                x0 = (g[0] * uc + g[1] * vc + g[2]) * w
                y0 = (g[3] * uc + g[4] * vc + g[5]) * w
                x1 = (n[0] * uc + n[1] * vc + n[2]) * w1
                y1 = (n[3] * uc + n[4] * vc + n[5]) * w1
                if surface is not None:
                    # (x, y, 1) = l G (u, v, 1) - e G s, with l such that the last is 1
                    excess = surface[v, u] - 1.0
                    x0 += excess * (shifts[i, 2] * x0 - shifts[i, 0])
                    y0 += excess * (shifts[i, 2] * y0 - shifts[i, 1])
                    x1 += excess * (shifts[i + 1, 2] * x1 - shifts[i + 1, 0])
                    y1 += excess * (shifts[i + 1, 2] * y1 - shifts[i + 1, 1])
                x = x0 + part * (x1 - x0)
                new = y0 + part * (y1 - y0) + center[1]
                done = abs(new - y) < 1e-3
                y = new
                if done:
                    break
            map_x[v, u] = x + center[0]
            map_y[v, u] = y
