"""Normalised correlation of small pieces with a reference, and where it is highest."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

FEWEST_ROWS, FEWEST_COLUMNS = 5, 12  # px; smaller pieces are not matched
FLAT = 1e-3  # grey levels^2, variance below which a window has no correlation
LANES, TAPS = 16, 8  # places and pixels of a piece that are worked out at a time
ROOM = LANES + TAPS  # values beyond the end of a reference that are read and do not count


@njit(**INLINED)
def add_taps(reference, at, piece, c, sums, to):
    """
    Add `TAPS` pixels of a row of a piece, times what lies at reference[at:], at `LANES` places.

    So many of each, known when this is compiled: vectors without remainders.
    """
    at = np.uint64(at)
    to = np.uint64(to)
    c = np.uint64(c)
    one = np.uint64(1)
    p0 = piece[c]
    p1 = piece[c + one]
    p2 = piece[c + np.uint64(2)]
    p3 = piece[c + np.uint64(3)]
    p4 = piece[c + np.uint64(4)]
    p5 = piece[c + np.uint64(5)]
    p6 = piece[c + np.uint64(6)]
    p7 = piece[c + np.uint64(7)]
    for k in range(np.uint64(LANES)):
        n = at + k
        sums[to + k] += (
            p0 * reference[n]
            + p1 * reference[n + one]
            + p2 * reference[n + np.uint64(2)]
            + p3 * reference[n + np.uint64(3)]
            + p4 * reference[n + np.uint64(4)]
            + p5 * reference[n + np.uint64(5)]
            + p6 * reference[n + np.uint64(6)]
            + p7 * reference[n + np.uint64(7)]
        )


@njit(**INLINED)
def window_sum(table, top, left, rows, columns):
    """Return the sum of a window by the table of sums from the corner on (M + 1, N + 1)."""
    return (
        table[top + rows, left + columns]
        - table[top, left + columns]
        - table[top + rows, left]
        + table[top, left]
    )


@njit(**INLINED)
def correlate(
    piece, width, energy, reference, columns, total, squares, textured, top, left, sums, scores
):
    """
    Write the correlations 0..1 of a piece, `width` wide, with windows of a reference.

    The mean of `piece` is 0, `energy` the sum of its squares, its columns are filled up with zeros
    to a multiple of `TAPS`, the room in `sums` to one of `LANES`. `reference` is flat, `columns`
    wide, `total` and `squares` the tables of its sums. The window of scores[0, 0] begins at `top`,
    `left`. Windows about flat ground, where `textured` (M, N) is 0, do not correlate.
    """
    rows = piece.shape[0]
    count = rows * width
    for i in range(scores.shape[0]):
        sums[:] = 0.0
        for r in range(rows):
            at = (top + i + r) * columns + left
            for to in range(0, sums.size, LANES):
                for c in range(0, piece.shape[1], TAPS):
                    add_taps(reference, at + to + c, piece[r], c, sums, to)
        for j in range(scores.shape[1]):
            mean = window_sum(total, top + i, left + j, rows, width) / count
            power = window_sum(squares, top + i, left + j, rows, width) - count * mean * mean
            scores[i, j] = 0.0
            if power > FLAT * count:
                score = sums[j] / math.sqrt(power * energy)
                known = textured[top + i + rows // 2, left + j + width // 2]
                scores[i, j] = min(max(score, 0.0), 1.0) * known


@njit(**INLINED)
def peak_of(scores, least, out):
    """
    Write place x, y, height and sharpness x, y of the highest of `scores`.

    Return False where it is below `least` or at the edge.
    """
    rows, columns = scores.shape
    row = 0
    col = 0
    for i in range(rows):
        for j in range(columns):
            if scores[i, j] > scores[row, col]:
                row = i
                col = j
    peak = scores[row, col]
    if peak < least or row == 0 or col == 0 or row == rows - 1 or col == columns - 1:
        return False
    for axis in range(2):
        a = scores[row, col - 1] if axis == 0 else scores[row - 1, col]
        c = scores[row, col + 1] if axis == 0 else scores[row + 1, col]
        bend = 2.0 * peak - a - c
        out[axis] = col if axis == 0 else row
        if bend > 1e-6:
            out[axis] += (c - a) / (2.0 * bend)
        out[3 + axis] = max(0.0, bend)
    out[2] = peak
    return True


@njit(**OPTIONS)
def highest(scores, least, out):
    """Write what `peak_of` says of scores; return whether it says anything."""
    return peak_of(scores, least, out)


@njit(**INLINED)
def match_band(
    small, top, height, x, y, reference, total, squares, textured, width, reach, edge, contrast,
    least, out,
):
    """
    Match the pieces, `width` px wide, of rows top..top + height of a live image (m, n).

    The live corner is expected at column `x` and row `y` of the reference, and looked for `reach`
    px around; `reference` is flat and has `ROOM` after it, see `correlate`. Pieces keep `edge` px
    from the ends of the reference. Pieces flatter than `contrast`
    are left out, correlations below `least`, too. Writes into `out` (k, 7), for each piece: its
    centre from that of the image x, y; its corner's place in the reference minus that in the image
    x, y; height and sharpness x, y of the correlation. Returns how many pieces.
    """
    live_columns = small.shape[1]
    ref_rows, ref_columns = textured.shape
    found = np.empty(5)
    count = 0
    for left in range(0, live_columns - width + 1, width):
        r0 = max(top, edge - y)
        r1 = min(top + height, ref_rows - y - edge)
        c0 = max(left, edge - x)
        c1 = min(left + width, ref_columns - x - edge)
        if r1 - r0 < FEWEST_ROWS or c1 - c0 < FEWEST_COLUMNS:
            continue
        rows = r1 - r0
        columns = c1 - c0
        mean = 0.0
        for r in range(r0, r1):
            for c in range(c0, c1):
                mean += small[r, c]
        mean /= rows * columns
        piece = np.zeros((rows, -(-columns // TAPS) * TAPS), np.float32)
        for r in range(rows):
            for c in range(columns):
                piece[r, c] = small[r0 + r, c0 + c] - mean
        energy = 0.0
        for r in range(rows):
            for c in range(columns):
                energy += piece[r, c] * piece[r, c]
        if energy < contrast * contrast * rows * columns:
            continue
        begin_y = max(0, r0 + y - reach)
        begin_x = max(0, c0 + x - reach)
        scores = np.empty(
            (
                min(ref_rows, r1 + y + reach) - begin_y - rows + 1,
                min(ref_columns, c1 + x + reach) - begin_x - columns + 1,
            ),
            np.float32,
        )
        sums = np.empty(-(-scores.shape[1] // LANES) * LANES, np.float32)
        correlate(
            piece, columns, energy, reference, ref_columns, total, squares, textured, begin_y,
            begin_x, sums, scores,
        )
        if peak_of(scores, least, found):
            out[count, 0] = 0.5 * (c0 + c1 - live_columns)
            out[count, 1] = 0.5 * (r0 + r1 - small.shape[0])
            out[count, 2] = begin_x + found[0] - c0
            out[count, 3] = begin_y + found[1] - r0
            out[count, 4:7] = found[2:5]
            count += 1
    return count


@njit(**OPTIONS)
def match_bands(
    first, last, small, tops, height, x, y, reference, total, squares, textured, width, reach, edge,
    contrast, least, out, counts,
):
    """
    Match the bands of rows that begin at tops[first:last], all around one place, see `match_band`.

    Writes into out[n] (k, 7) for band n, and how many pieces into counts[n].
    """
    for n in range(first, last):
        counts[n] = match_band(
            small, tops[n], height, x, y, reference, total, squares, textured, width, reach, edge,
            contrast, least, out[n],
        )


@njit(**INLINED)
def trust_in(piece, least, axis):
    """Return the trust in one component x, y of what `match_band` writes of a piece."""
    return min(1.0, 5.0 * piece[5 + axis]) * (piece[4] - least + 0.05)


@njit(**INLINED)
def moved_corner(pieces, count, least, corner):
    """Write where the piece of a band that is trusted most puts the live corner, if there is."""
    best = 0.0
    for k in range(count):
        trust = min(trust_in(pieces[k], least, 0), trust_in(pieces[k], least, 1))
        if k == 0 or trust > best:
            best = trust
            corner[0] = pieces[k, 2]
            corner[1] = pieces[k, 3]


@njit(**OPTIONS)
def follow_bands(
    anchor, step, corner, same_place, small, tops, height, reference, total, squares, textured,
    width, reach, edge, contrast, least, out, counts,
):
    """
    Match the bands on one side of the `anchor` again, each where the last one lies.

    `step` is 1 or -1. All are matched around the live `corner` x, y (2,) already; bands that lie
    no more than `same_place` px from there stay as they are, see `match_bands`.
    """
    place = corner.copy()
    moved_corner(out[anchor], counts[anchor], least, place)
    n = anchor + step
    while 0 <= n < tops.size:
        if max(abs(place[0] - corner[0]), abs(place[1] - corner[1])) > same_place:
            counts[n] = match_band(
                small, tops[n], height, round(place[0]), round(place[1]), reference, total, squares,
                textured, width, reach, edge, contrast, least, out[n],
            )
        moved_corner(out[n], counts[n], least, place)
        n += step


@njit(**OPTIONS)
def listed(out, counts, least, table):
    """
    Write the pieces of all bands below each other, with the trust in them; return how many.

    Rows of `table` (n, 6): centre x, y, place of the corner x, y, trust x, y.
    """
    n = 0
    for band in range(counts.size):
        for k in range(counts[band]):
            table[n, :4] = out[band, k, :4]
            for axis in range(2):
                table[n, 4 + axis] = trust_in(out[band, k], least, axis)
            n += 1
    return n


@njit(**OPTIONS)
def best_band(out, counts, least):
    """Return which band has the most trusted pieces, the first of such."""
    best = 0
    most = -1.0
    for band in range(counts.size):
        total = 0.0
        for k in range(counts[band]):
            total += min(trust_in(out[band, k], least, 0), trust_in(out[band, k], least, 1))
        if total > most:
            most = total
            best = band
    return best
