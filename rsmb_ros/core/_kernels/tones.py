"""How the display values of two images differ, intensity by intensity."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import OPTIONS


@njit(**OPTIONS)
def count_offsets(shown, live, asked, cell, bright, most, sums):
    """
    Sum up how far a live image is lighter than what is shown, by place and intensity.

    Every pixel that is `asked` (M, N) and less than `bright` in both counts, at most `most` grey
    levels. Images are (M, N, C) uint8; `sums` (C, cells, bins, 3) int64 becomes number, intensity
    and offset in each `cell` x `cell` pixels.
    """
    rows, columns, colours = shown.shape
    across = (columns + cell - 1) // cell
    width = 256 // sums.shape[2]
    for y in range(rows):
        for x in range(columns):
            if not asked[y, x]:
                continue
            at = (y // cell) * across + x // cell
            for c in range(colours):
                before = np.int64(shown[y, x, c])
                after = np.int64(live[y, x, c])
                if before < bright and after < bright:
                    own = sums[c, at, before // width]
                    own[0] += 1
                    own[1] += before
                    own[2] += min(max(after - before, -most), most)


@njit(**OPTIONS)
def add_offsets(places, offsets, curve, sharpest, normal, target):
    """
    Add the normal equations of a curve through offsets (n,) at `places` (n,) [knots].

    `curve` (K,) holds what is known of it at the knots, it is straight in between. The loss is that
    of medians: weights are 1 over the misfit, which counts as `sharpest` at least.
    """
    last = curve.size - 2
    for n in range(places.size):
        i = min(int(places[n]), last)
        after = places[n] - i
        before = 1.0 - after
        misfit = offsets[n] - before * curve[i] - after * curve[i + 1]
        weight = 1.0 / max(abs(misfit), sharpest)
        normal[i, i] += weight * before * before
        normal[i, i + 1] += weight * before * after
        normal[i + 1, i] += weight * before * after
        normal[i + 1, i + 1] += weight * after * after
        target[i] += weight * before * offsets[n]
        target[i + 1] += weight * after * offsets[n]


@njit(**OPTIONS)
def add_tones(shown, colours, offsets, weights, grey):
    """
    Show values (n * C,) uint8 with the `offsets` (C, 256) of their colours.

    `grey` (n,) float32, their mixture by `weights` (C,), follows.
    """
    count = weights.size
    for k in range(grey.size):
        for c in range(count):
            value = colours[count * k + c]
            lighter = np.float32(value) + offsets[c, value]
            lighter = min(max(lighter, np.float32(0.0)), np.float32(255.0))
            grey[k] += weights[c] * (lighter - np.float32(value))
            shown[count * k + c] = np.uint8(np.int32(lighter + np.float32(0.5)))
