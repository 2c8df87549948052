"""The kernels behind fronts against literal loops over homographies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core._kernels.cover import BENT, draw_masks, watch_cover
from rsmb_ros.core.motion import homographies, shifted

pytestmark = pytest.mark.oracle
LEFT, TOP = -3, 5  # of a cover, that begins outside the reference


def places(path, row, columns, times, depth):
    """Where the live pixels of a row lie in the reference at some times, x and y (times, n)."""
    center = path.grid.center
    points = np.stack([columns - center[0], np.full(len(columns), row - center[1])])
    mapped = homographies(path.coordinates(times), path.grid, depth) @ np.concatenate(
        [points, np.ones((1, len(columns)))]
    )
    return mapped[:, 0] / mapped[:, 2] + center[2], mapped[:, 1] / mapped[:, 2] + center[3]


def at(cover, u, v):
    """Values of a cover, each from a pixel to the next, 0 beyond its ends."""
    i, j = np.floor(v).astype(int) - TOP, np.floor(u).astype(int) - LEFT
    inside = (i >= 0) & (j >= 0) & (i < cover.shape[0]) & (j < cover.shape[1])
    return np.where(inside, cover[np.where(inside, i, 0), np.where(inside, j, 0)], 0)


def test_masks_are_drawn_at_the_nearest_pixels(bent_path):
    rng = np.random.default_rng(5)
    perhaps = rng.random((12, 15)) < 0.6
    masks = np.stack([perhaps & (rng.random(perhaps.shape) < 0.5), perhaps])
    x, y, depth = 20, 9, 0.8
    mapping = bent_path.row_homographies(depth)[y : y + 12].reshape(-1, 9)
    out = np.zeros((2, 14, 22), np.uint8)
    left, top = 21, 8  # cuts some off on each side
    draw_masks(masks, x, y, mapping, bent_path.grid.center, left, top, out)
    expected = np.zeros_like(out)
    center = bent_path.grid.center
    dropped = 0
    for n, row, col in np.argwhere(masks):
        point = np.array([x + col - center[0], y + row - center[1], 1.0])
        u, v, w = mapping[row].reshape(3, 3) @ point
        i = int(np.floor(v / w + center[3] + 0.5)) - top
        j = int(np.floor(u / w + center[2] + 0.5)) - left
        if 0 <= i < out.shape[1] and 0 <= j < out.shape[2]:
            expected[n, i, j] = 1
        else:
            dropped += 1
    assert dropped > 3
    assert expected[1].sum() > expected[0].sum() > 20
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize('depth', [1.0, 0.8])
@pytest.mark.parametrize('bottom_up', [False, True])
def test_a_pixel_sees_the_least_and_greatest_of_what_it_passes(bent_path, depth, bottom_up):
    path = replace(bent_path, bottom_up=bottom_up)
    rng = np.random.default_rng(6)
    cover = np.repeat(np.repeat(rng.integers(0, 3, (7, 9), dtype=np.uint8), 5, axis=0), 5, axis=1)
    shift, duration = (1.3, -0.7), 8.0
    samples = np.arange(40) % 4 + 2
    top, left = 3, 4
    least, greatest = np.empty((2, 33, 40), np.uint8)
    watch_cover(
        top, left, cover, LEFT, TOP, path.row_times, samples, path.control, path.first_time,
        path.knot_rows, duration, path.grid.focal_px, path.grid.center, 1.0 / depth,
        np.array(shift), least, greatest,
    )  # fmt: skip
    moved = shifted(path, depth, shift)
    columns = np.arange(left, left + 40)
    same = 0
    for row in range(33):
        times = path.row_times[top + row] + np.linspace(-0.5, 0.5, samples[top + row]) * duration
        u, v = places(moved, top + row, columns, times, depth)
        # a place may be off by BENT in x and y, and so lie after the next pixel
        off = 1.01 * BENT * np.array([(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])
        seen = np.array([at(cover, u + x, v + y) for x, y in off])
        for found, extreme in ((least, np.min), (greatest, np.max)):
            surely, perhaps = extreme(seen.min(axis=0), axis=0), extreme(seen.max(axis=0), axis=0)
            assert np.all((surely <= found[row]) & (found[row] <= perhaps))
            same += np.count_nonzero(found[row] == extreme(seen[0], axis=0))
    assert same > 0.97 * 2 * least.size
    assert set(np.unique(least)) == set(np.unique(greatest)) == {0, 1, 2}
