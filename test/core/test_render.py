"""A frame as the live camera shows it, against its planes rendered one by one."""

from __future__ import annotations

from dataclasses import replace

import naive
import numpy as np
import pytest

from rsmb_ros.core._kernels import display, render
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.photometric import Light, luma
from rsmb_ros.core.render import Window, blurred, shown
from rsmb_ros.core.sampling import colour_of, half_pixel, side_by_side
from rsmb_ros.core.workers import Workers

pytestmark = pytest.mark.oracle
LIGHT = Light(np.array([1.1, 0.03, -0.02, -0.08]), 1.5)
GAMMA = 2.2
OFF = 0.0015  # grey levels, of the kernel's power


def planes_of(texture_of):
    return [half_pixel(texture_of(44, 52, seed).astype(np.float32)) for seed in (3, 4, 5)]


def expected_of(planes, path, executor, depth):
    parts = [blurred(plane, path, executor, depth) for plane in planes]
    return LIGHT.apply(np.dstack([image for image, _ in parts]), GAMMA), parts[0][1]


@pytest.mark.parametrize('depth', [1.0, 0.8])
def test_colours_are_blurred_apart_lit_and_mixed(bent_path, texture_of, executor, depth):
    planes = planes_of(texture_of)
    found = shown(side_by_side(planes), bent_path, LIGHT, GAMMA, executor, depth)
    expected, complete = expected_of(planes, bent_path, executor, depth)
    assert 0.5 < complete.mean() < 1.0
    np.testing.assert_array_equal(found.complete, complete)
    np.testing.assert_allclose(found.grey, luma(expected), atol=2 * OFF)
    rounding = np.abs(found.colours - expected)[complete]
    assert rounding.max() <= 0.5 + OFF
    assert np.all(found.colours[~complete] == 0)


def test_one_plane_is_shown_like_three_equal_ones(bent_path, texture_of, executor):
    plane = planes_of(texture_of)[0]
    grey = shown(plane, bent_path, LIGHT, GAMMA, executor)
    colour = shown(side_by_side([plane] * 3), bent_path, LIGHT, GAMMA, executor)
    np.testing.assert_allclose(grey.grey, colour.grey, atol=1e-3)  # float32, weights sum to 1
    np.testing.assert_array_equal(grey.complete, colour.complete)
    assert grey.colours.shape == grey.grey.shape
    assert np.abs(grey.colours[..., None].astype(int) - colour.colours).max() <= 1


def test_a_window_shows_its_part_of_the_frame(bent_path, texture_of, executor):
    fine = side_by_side(planes_of(texture_of))
    whole = shown(fine, bent_path, LIGHT, GAMMA, executor)
    window = Window(5, 33, 7, 41)
    part = shown(fine, bent_path, LIGHT, GAMMA, executor, window=window)
    steepest = max(np.abs(np.diff(whole.grey, axis=axis)).max() for axis in (0, 1))  # per px
    limit = 2 * render.BENT * steepest  # the pieces of its rows are others
    np.testing.assert_allclose(part.grey, whole.grey[window.box], atol=limit)
    empty = shown(fine, bent_path, LIGHT, GAMMA, executor, window=Window(3, 3, 7, 41))
    assert empty.grey.shape == (0, 34)
    assert empty.colours.shape == (0, 34, 3)


def test_places_of_a_tilted_row_are_right_to_bent_px(texture_of, executor):
    """A ramp shows where each pixel was read."""
    tilted = still_path(Grid((64, 400), (64, 400), 300.0), 20.0, 0.0, 4.0, False)
    tilted = replace(tilted, control=tilted.control + np.array([3, -2, 25, 9, 14, -8]))
    x = np.tile(np.arange(800, dtype=np.float32) / 2.0, (128, 1))
    image, complete = blurred(x, tilted, executor)
    for row in (10, 33, 50):
        expected = naive.blurred_row(x, tilted, row, 2)
        known = complete[row]
        assert known.mean() > 0.5
        # and float32: 400 px are known to 3e-5
        np.testing.assert_allclose(image[row][known], expected[known], atol=render.BENT + 1e-3)


@pytest.mark.parametrize('exponent', [1.0, 1 / 1.8, 1 / 2.2, 1 / 4.0])
def test_power_is_exact_to_thousandths_of_a_grey_level(exponent):
    x = np.concatenate([np.geomspace(1e-20, 1.0, 5000), np.linspace(0.001, 1.0, 5000)])
    x = x.astype(np.float32)
    found = [display.power(value, np.float32(exponent)) for value in x]
    expected = x.astype(np.float64) ** np.float32(exponent)
    assert 255.0 * np.abs(np.array(found, np.float64) - expected).max() < OFF


def test_colours_side_by_side_are_the_planes(texture_of):
    planes = planes_of(texture_of)
    beside = side_by_side(planes)
    assert beside.shape == (88, 2, 52, 3)
    assert beside[9, 1, 20, 2] == planes[2][9, 41]
    for c, plane in enumerate(planes):
        np.testing.assert_array_equal(colour_of(beside, c), plane)


def test_threads_do_not_change_a_bit(bent_path, texture_of):
    fine = side_by_side([np.tile(plane, (4, 4)) for plane in planes_of(texture_of)])
    grid = replace(bent_path.grid, live_shape=(160, 208), reference_shape=(176, 208))
    path = replace(bent_path, grid=grid)
    found = []
    for threads in (1, 2, 5):
        with Workers(threads) as workers:
            found.append(shown(fine, path, LIGHT, GAMMA, workers))
    for other in found[1:]:
        np.testing.assert_array_equal(found[0].grey, other.grey)
        np.testing.assert_array_equal(found[0].colours, other.colours)
