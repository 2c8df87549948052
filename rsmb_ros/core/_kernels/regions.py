"""Connected regions of an image."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

SEGMENT = 64  # px of a row that are looked at together


@njit(**INLINED)
def inside_weak(image, low, y, x):
    """Say whether a pixel and its eight neighbours exceed `low`; outside the image all does."""
    for i in range(max(0, y - 1), min(image.shape[0], y + 2)):
        for j in range(max(0, x - 1), min(image.shape[1], x + 2)):
            if not image[i, j] > low:
                return False
    return True


@njit(**INLINED)
def somewhere_above(row, begin, end, high):
    """Say whether row[begin:end] exceeds `high` somewhere."""
    above = 0
    for x in range(np.uint64(begin), np.uint64(end)):
        above += row[x] > high
    return above > 0


@njit(**OPTIONS)
def grow_regions(image, low, high, waiting, out, box):
    """
    Mark the regions above `low`, a pixel taken off all around, that somewhere exceed `high`.

    `image` (M, N) float32; `out` (M, N) uint8 must be 0, `waiting` holds M N places. `box` becomes
    top, left, bottom, right (exclusive) of all regions, all 0 where there is none.
    """
    rows, columns = image.shape
    top, left, bottom, right = rows, columns, 0, 0
    for first in range(rows):
        for begin in range(0, columns, SEGMENT):
            end = min(begin + SEGMENT, columns)
            # nearly all of a frame is passed over here, many pixels at a time
            if not somewhere_above(image[first], begin, end, high):
                continue
            for second in range(begin, end):
                if not image[first, second] > high or out[first, second]:
                    continue
                if not inside_weak(image, low, first, second):
                    continue
                out[first, second] = 1
                waiting[0] = first * columns + second
                count = 1
                while count > 0:
                    count -= 1
                    y = waiting[count] // columns
                    x = waiting[count] - y * columns
                    top = min(top, y)
                    left = min(left, x)
                    bottom = max(bottom, y + 1)
                    right = max(right, x + 1)
                    for i in range(max(0, y - 1), min(rows, y + 2)):
                        for j in range(max(0, x - 1), min(columns, x + 2)):
                            if out[i, j] or not image[i, j] > low:
                                continue
                            if inside_weak(image, low, i, j):
                                out[i, j] = 1
                                waiting[count] = i * columns + j
                                count += 1
    if bottom > 0:
        box[0] = top
        box[1] = left
        box[2] = bottom
        box[3] = right
    else:
        box[:] = 0
