"""Poses, path coordinates and the spline between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core.motion import (
    Grid,
    coordinates_from_poses,
    homographies,
    poses_from_coordinates,
    shifted,
    still_path,
)

GRID = Grid((480, 640), (600, 800), 580.0)


def test_poses_and_path_coordinates_are_inverse():
    rng = np.random.default_rng(2)
    poses = rng.normal([0, 0, 0, 1, 0, 0], [40, 40, 4, 0.05, 2, 2], (50, 6))
    back = poses_from_coordinates(coordinates_from_poses(poses, GRID), GRID)
    np.testing.assert_allclose(back, poses, atol=1e-9)


def test_pure_translation_moves_every_pixel_alike():
    coordinates = coordinates_from_poses(np.array([[7.0, -3.0, 0, 1, 0, 0]]), GRID)
    h = homographies(coordinates, GRID)[0]
    np.testing.assert_allclose(h, [[1, 0, 7], [0, 1, -3], [0, 0, 1]], atol=1e-12)


def test_translation_of_a_layer_is_that_of_the_ground_over_its_depth():
    coordinates = coordinates_from_poses(np.array([[6.0, -3.0, 0, 1, 0, 0]]), GRID)
    h = homographies(coordinates, GRID, relative_depth=0.5)[0]
    np.testing.assert_allclose(h[:2, 2], [12.0, -6.0], atol=1e-12)  # t_L / d


def test_zoom_and_translation_of_a_layer_follow_the_report():
    """Section 2.1.2: rho = d + 1/s_L - 1, s = d / rho, t = (rho - d + 1) t_L / rho."""
    d, s_ground, t_ground = 0.8, 1.05, 9.0
    coordinates = coordinates_from_poses(np.array([[t_ground, 0, 0, s_ground, 0, 0]]), GRID)
    h = homographies(coordinates, GRID, relative_depth=d)[0]
    rho = d + 1 / s_ground - 1
    np.testing.assert_allclose(h[0, 0] / h[2, 2], d / rho, rtol=1e-12)
    np.testing.assert_allclose(h[0, 2] / h[2, 2], (rho - d + 1) * t_ground / rho, rtol=1e-12)


def test_rotation_does_not_depend_on_depth():
    coordinates = coordinates_from_poses(np.array([[0, 0, 3.0, 1, 0.5, -0.4]]), GRID)
    near, far = (homographies(coordinates, GRID, d)[0] for d in (0.5, 1.0))
    np.testing.assert_allclose(near, far, atol=1e-9)


def test_bottom_up_readout_reverses_the_rows():
    path = still_path(GRID, 24.0, 30.0, 40.0, bottom_up=True)
    assert path.row_times[0] == 479
    assert path.row_times[-1] == 0


def test_instants_of_a_row_grow_with_its_path():
    path = still_path(GRID, 24.0, 40.0, 50.0, bottom_up=False)
    still = path.samples_per_row(1.0)
    control = path.control.copy()
    control[:, 0] = 12.0 * np.arange(len(control))  # 0.5 px per row: 20 px of blur
    moving = replace(path, control=control).samples_per_row(1.0)
    assert np.all(still == 2)
    assert abs(int(np.median(moving)) - 21) <= 1


@pytest.mark.parametrize('depth', [1.0, 0.8, 1.2])
def test_shift_moves_a_layer_by_so_many_pixels(bent_path, depth):
    """Whatever the depth: t / d has to hold what is added to t."""
    before = bent_path.row_homographies(depth)
    after = shifted(bent_path, depth, (1.5, -0.5)).row_homographies(depth)
    # at the centre of the frame, per unit of zoom (within 4 % on this path)
    moved = after[:, :2, 2] / after[:, 2, 2:] - before[:, :2, 2] / before[:, 2, 2:]
    np.testing.assert_allclose(moved, np.tile([1.5, -0.5], (len(moved), 1)), rtol=0.1)


def test_no_shift_is_the_path_itself(bent_path):
    assert shifted(bent_path, 0.8, (0.0, 0.0)) is bent_path
