"""Where a live image is compared with the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsmb_ros.core.photometric import to_display, to_linear
from rsmb_ros.core.points import LiveImage, select_points
from rsmb_ros.core.sampling import pyramid


def test_points_of_a_live_image_are_those_of_its_halvings(texture_of):
    grey = texture_of(120, 160, 3).astype(np.float32)
    live = LiveImage(grey, 2.2)
    found = live.points(3)
    for n, image in enumerate(pyramid(to_linear(grey, 2.2), 3)):
        expected = select_points(to_display(image, 2.2) if n else grey, n)
        np.testing.assert_array_equal(found[n].columns, expected.columns)
        np.testing.assert_array_equal(found[n].values, expected.values)
    assert live.points(2)[1] is found[1]  # chosen once


def test_every_second_row_keeps_its_points_and_their_depth(texture_of):
    points = select_points(texture_of(120, 160, 3).astype(np.float32), 0)
    points = replace(points, inverse_depth=np.ones_like(points.values))
    few = points.every(2)
    np.testing.assert_array_equal(few.rows, points.rows[::2])
    for name in ('columns', 'values', 'inverse_depth'):
        kept = getattr(few, name)
        np.testing.assert_array_equal(kept, getattr(points, name)[::2])
        assert kept.flags.c_contiguous  # else kernels would be compiled once more


def test_points_between_rows_of_the_full_image(texture_of):
    live = LiveImage(texture_of(120, 160, 3).astype(np.float32), 2.2)
    for n, points in enumerate(live.points(2)):
        found = points.between(40, 80, n)
        middles = (points.rows + 0.5) * 2**n - 0.5
        chosen = (middles >= 40) & (middles < 80)
        np.testing.assert_array_equal(found.rows, points.rows[chosen])
        np.testing.assert_array_equal(found.values, points.values[chosen])
    assert live.points(1)[0].between(0, 120, 0).rows.size == live.points(1)[0].rows.size
