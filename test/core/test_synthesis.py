"""The forward model against closed forms and literal equations."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from rsmb_ros.core.motion import Grid
from rsmb_ros.core.photometric import to_display, to_linear
from rsmb_ros.core.scenes import aerial_scene
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    CHANGED,
    OUTSIDE,
    RIM_COVER,
    Nuisances,
    Scene,
    Sheet,
    live_frame,
    reference_image,
)

GRID = Grid((60, 80), (60, 80), 72.0)
RNG = 20170301


def moving(t_x=0.0, t_y=0.0, v_x=0.0, v_y=0.0):
    """Path of constant velocity [px, px/row]."""

    def poses(times):
        out = np.zeros((len(times), 6))
        out[:, 3] = 1.0
        out[:, 0], out[:, 1] = t_x + v_x * times, t_y + v_y * times
        return out

    return poses


@pytest.fixture(scope='module')
def scene(texture_of):
    return Scene(texture_of(100, 120, 11), margin=20)


def exposed(scene, path, exposure, rolling=True, nuisances=None, objects=()):
    timing = ShutterTiming(exposure, rolling=rolling)
    nuisances = nuisances or Nuisances(gamma=1.0)
    rng = np.random.default_rng(RNG)
    return live_frame(scene, objects, GRID, path, timing, nuisances, rng)


def test_still_camera_sees_the_reference(scene):
    live, truth = exposed(scene, moving(), 12.0)
    reference = reference_image(scene, Nuisances(gamma=1.0), np.random.default_rng(0))
    np.testing.assert_array_equal(live, reference)
    np.testing.assert_array_equal(reference, scene.background[20:-20, 20:-20])
    assert not truth.label.any()


def test_constant_velocity_without_blur_is_an_exact_shear(scene):
    live, _ = exposed(scene, moving(v_x=0.25), 0.0)
    for row in (0, 4, 20, 40):  # whole-pixel shifts: no interpolation at all
        expected = scene.background[20 + row, 20 + row // 4 : 100 + row // 4]
        np.testing.assert_array_equal(live[row], expected)


def test_global_shutter_moves_all_rows_alike(scene):
    live, _ = exposed(scene, moving(t_x=-29.5, v_x=1.0), 0.0, rolling=False)
    np.testing.assert_array_equal(live, scene.background[20:-20, 20:-20])


def test_blur_is_the_mean_of_literal_warps_in_linear_light(scene):
    """Eq. 1 with the poses of the exposure one by one, summed as light."""
    gamma, exposure, speed = 2.2, 8.0, 0.5
    live, truth = exposed(scene, moving(3.0, 1.5, speed), exposure, nuisances=Nuisances())
    linear = to_linear(scene.background.astype(np.float32), gamma)
    count = 160
    for row, column in ((10, 20), (30, 40), (50, 60)):
        total = 0.0
        for k in range(count):
            time = row + ((k + 0.5) / count - 0.5) * exposure
            u, v = column + 20 + 3.0 + speed * time, row + 20 + 1.5
            total += naive.cubic(linear, v, u) / count
        expected = to_display(np.array(total), gamma)
        assert abs(truth.clean[row, column] - expected) < 0.2  # 8 instants against 160
        assert abs(float(live[row, column]) - expected) < 0.8  # + rounding to uint8


def test_layer_moves_by_its_depth_and_hides_the_ground(texture_of):
    roof = Sheet(np.full((12, 16), 250, np.uint8), np.ones((12, 16), np.float32), 30, 20, 0.5)
    scene = Scene(np.full((100, 120), 40, np.uint8), 20, (roof,))
    live, truth = exposed(scene, moving(t_x=-4.0), 0.0)
    reference = reference_image(scene, Nuisances(gamma=1.0), np.random.default_rng(0))
    left = [int(np.argmax(image[26] > 200)) for image in (reference, live)]
    assert left == [30, 38]  # t / d = -8: the roof lies 8 px further right in the live frame
    assert not (truth.label == CHANGED).any()


def test_object_outside_and_rim_are_labelled():
    thing = Sheet(
        np.full((14, 14), 255, np.uint8), np.ones((14, 14), np.float32), 40, 20, name='box'
    )
    scene = Scene(np.full((60, 80), 90, np.uint8), 0)
    live, truth = exposed(scene, moving(t_x=-10.0, v_x=0.3), 10.0, objects=(thing,))
    assert list(truth.objects) == ['box']
    x, y, width, height = truth.objects['box']
    assert (y, height) == (20, 14)
    assert 39 <= x <= 42  # 40 + 10 - 0.3 * row at the last row
    assert 56 <= x + width <= 60  # 14 px wider at the first row
    assert np.all(live[truth.label == CHANGED] > 160)
    assert np.all(truth.label[:8, :8] == OUTSIDE)  # starts 10 px left of the reference
    assert not np.any(truth.label[32:34, 4:-4] == OUTSIDE)  # by then it is back
    assert not np.any(live[truth.label == 0] > 90 + RIM_COVER * 165 + 1)


@pytest.mark.parametrize(
    ('nuisance', 'check'),
    [
        ({'gain': 1.2}, lambda clean, live: abs(np.median(live / clean) - 1.2) < 0.01),
        ({'bias': 6.0}, lambda clean, live: abs(np.median(live - clean) - 6.0) < 0.1),
        ({'read_noise': 3.0}, lambda clean, live: 2.8 < np.std(live - clean) < 3.2),
        (
            {'noise_electrons': 2000.0},
            lambda clean, live: 0.9 < np.std((live - clean) / np.sqrt(clean * 255 / 2000)) < 1.1,
        ),
        (
            {'vignetting': 0.3},
            lambda clean, live: (
                abs((live / clean)[:4, :4].mean() - 0.7) < 0.04
                and abs((live / clean)[28:32, 38:42].mean() - 1.0) < 0.02
            ),
        ),
        ({'jpeg_quality': 40}, lambda clean, live: 1.0 < np.std(live - clean) < 8.0),
    ],
)
def test_each_nuisance_does_what_its_parameter_says(scene, nuisance, check):
    clean, _ = exposed(scene, moving(), 0.0, nuisances=Nuisances(gamma=1.0))
    live, _ = exposed(scene, moving(), 0.0, nuisances=Nuisances(gamma=1.0, **nuisance))
    keep = np.where(clean > 20, clean, np.nan)
    ratio_safe = np.nan_to_num(keep, nan=120.0)
    assert check(ratio_safe.astype(float), np.where(np.isnan(keep), 120.0, live).astype(float))


def test_equal_seeds_give_equal_images():
    first, second = (aerial_scene((96, 128), np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first.scene.background, second.scene.background)
    other = aerial_scene((96, 128), np.random.default_rng(6))
    assert np.any(first.scene.background != other.scene.background)
