"""Camera paths do what their names say."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis.exposure import pixel_moves, row_instants
from rsmb_ros.core.synthesis.paths import (
    MOTIONS,
    POSE_ZERO,
    SIX_DOF,
    Hover,
    blurred_by,
    constant,
    jello,
    offset,
    stairs,
    still,
    swaying_by,
    wobble,
)

ROWS = 240
TIMES = np.arange(float(ROWS))
TIMING = ShutterTiming(40.0)


def test_still_camera_stays_at_pose_zero():
    np.testing.assert_array_equal(still(TIMES), np.tile(POSE_ZERO, (ROWS, 1)))


def test_constant_velocity_is_exact():
    velocity = np.array([0.1, -0.2, 0.01, 1e-5, 0.0, 0.002])
    np.testing.assert_allclose(
        np.diff(constant(velocity, ROWS)(TIMES), axis=0) - velocity, 0, atol=1e-12
    )


def test_jello_repeats_after_its_period():
    path = jello(np.random.default_rng(1), SIX_DOF, 80.0)
    np.testing.assert_allclose(path(TIMES), path(TIMES + 80.0), atol=1e-9)


def test_parts_add_up_around_the_place():
    place = np.array([5.0, -3.0, 1.0, 1.02, 0.1, 0.2])
    path = offset(place, constant(SIX_DOF, ROWS), still)
    np.testing.assert_allclose(path(TIMES) - place, constant(SIX_DOF, ROWS)(TIMES) - POSE_ZERO)


@pytest.mark.parametrize('motion', MOTIONS)
def test_blur_is_scaled_to_the_wanted_length(motion):
    path = wobble(motion, SIX_DOF, TIMING, ROWS, np.random.default_rng(7))
    blurred = blurred_by(path, 9.0, TIMING, ROWS)
    poses = row_instants(blurred, TIMING, ROWS, 200)
    lengths = [pixel_moves(row).sum() * 200 / 199 for row in poses]
    assert abs(np.median(lengths) - 9.0) < 0.1  # 33 instants against 200


def test_sway_is_scaled_to_the_wanted_reach():
    path = swaying_by(wobble('smooth', SIX_DOF, TIMING, ROWS, np.random.default_rng(7)), 6.0, ROWS)
    reach = [pixel_moves(np.stack([POSE_ZERO, pose])).sum() for pose in path(TIMES)]
    assert np.max(reach) == pytest.approx(6.0)


@pytest.mark.parametrize('motion', MOTIONS)
def test_motion_is_smooth_from_row_to_row(motion):
    path = wobble(motion, SIX_DOF, TIMING, ROWS, np.random.default_rng(3))
    poses = blurred_by(path, 8.0, TIMING, ROWS)(TIMES)
    assert pixel_moves(poses).max() < 1.0  # px a row: five times the mean speed


def test_hover_blurs_every_row_alike():
    hover = Hover(20.0, 8.0, 50.0, 6e-5)
    poses = row_instants(lambda times: hover.poses(0.0, times), ShutterTiming(50.0), ROWS, 100)
    shifts = [np.hypot(*np.diff(row[:, :2], axis=0).T).sum() * 100 / 99 for row in poses]
    np.testing.assert_allclose(shifts, 8.0, rtol=0.02)  # the slow drift adds a little


@pytest.mark.parametrize(('a', 'b'), [(20, 3), (1, 3), (7, 2)])
def test_row_i_uses_the_a_poses_that_start_at_i_b(a, b):
    """Recipe of the ECCV 2014 paper: (M-1) b + a poses."""
    poses = np.arange((30 - 1) * b + a)[:, None] * np.ones(6)
    path, timing = stairs(poses, b, a), ShutterTiming(a / b)
    for row, used in enumerate(row_instants(path, timing, 30, a)):
        np.testing.assert_array_equal(used[:, 0], np.arange(row * b, row * b + a))


def test_shutter_from_seconds_is_the_ratio():
    timing = ShutterTiming.from_seconds(3e-3, 6e-5, bottom_up=True)
    assert timing.exposure_rows == pytest.approx(50.0)
    assert timing.bottom_up
