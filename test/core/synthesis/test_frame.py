"""The forward model against closed forms and literal equations; the truth that comes with it."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.photometric import to_display, to_linear
from rsmb_ros.core.sampling import half_pixel
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    CHANGED,
    GONE,
    NEW,
    OUTSIDE,
    RIM,
    RIM_COVER,
    Nuisances,
    Scene,
    Sheet,
    live_frame,
    reference_image,
)
from rsmb_ros.core.synthesis.exposure import expose
from rsmb_ros.core.synthesis.objects import cast_shadow
from rsmb_ros.core.synthesis.paths import POSE_ZERO, still

GRID = Grid((60, 80), (60, 80), 72.0)
RNG = 20170301
PLAIN = Nuisances(gamma=1.0)


def moving(t_x=0.0, t_y=0.0, v_x=0.0, v_y=0.0):
    """Path of constant velocity [px, px/row]."""

    def poses(times):
        out = np.tile(POSE_ZERO, (len(times), 1))
        out[:, 0], out[:, 1] = t_x + v_x * times, t_y + v_y * times
        return out

    return poses


def bent(times):
    """All six components change while the rows are read."""
    t = np.asarray(times)[:, None] / 60
    return POSE_ZERO + t * [4.0, -3.0, 2.0, 0.02, 0.6, -0.5] + [1.0, 2.0, -1.0, 0.01, 0.2, 0.1]


def box(x, y, side=14, value=255, **options):
    texture = np.full((side, side), value, np.uint8)
    cover = np.ones((side, side), np.float32)
    return Sheet(texture, cover, x, y, **{'name': 'box', 'kind': NEW, **options})


@pytest.fixture(scope='module')
def scene(texture_of):
    return Scene(texture_of(100, 120, 11), margin=20)


def exposed(scene, path, exposure, rolling=True, nuisances=PLAIN, objects=(), **options):
    timing = ShutterTiming(exposure, rolling=rolling)
    rng = np.random.default_rng(RNG)
    return live_frame(scene, objects, GRID, path, timing, nuisances, rng, **options)


def test_still_camera_sees_the_reference(scene):
    live, truth = exposed(scene, still, 12.0)
    reference = reference_image(scene, PLAIN, np.random.default_rng(0))
    np.testing.assert_array_equal(live, reference)
    np.testing.assert_array_equal(reference, scene.background[20:-20, 20:-20])
    assert not truth.label.any()
    y, x = np.mgrid[:60, :80]
    np.testing.assert_allclose(truth.places, np.stack([x, y], axis=2), atol=1e-4)


def test_constant_velocity_without_blur_is_an_exact_shear(scene):
    live, _ = exposed(scene, moving(v_x=0.25), 0.0)
    for row in (0, 4, 20, 40):  # whole-pixel shifts: no interpolation at all
        expected = scene.background[20 + row, 20 + row // 4 : 100 + row // 4]
        np.testing.assert_array_equal(live[row], expected)


def test_vertical_velocity_stretches_the_frame(scene):
    """A camera that runs along with the readout sees every row v_y rows further on."""
    live, _ = exposed(scene, moving(v_y=0.5), 0.0)
    for row in (0, 10, 30):
        expected = scene.background[20 + row + row // 2, 20:100]
        np.testing.assert_array_equal(live[row], expected)


def test_bottom_up_readout_shears_the_other_way(scene):
    timing = ShutterTiming(0.0, bottom_up=True)
    rng = np.random.default_rng(RNG)
    live, _ = live_frame(scene, (), GRID, moving(v_x=0.25), timing, PLAIN, rng)
    np.testing.assert_array_equal(live[59], scene.background[79, 20:100])
    np.testing.assert_array_equal(live[19], scene.background[39, 30:110])


def test_global_shutter_moves_all_rows_alike(scene):
    live, _ = exposed(scene, moving(t_x=-29.5, v_x=1.0), 0.0, rolling=False)
    np.testing.assert_array_equal(live, scene.background[20:-20, 20:-20])


def test_global_shutter_blur_is_the_same_in_all_rows():
    """A vertical edge under uniform motion becomes a ramp as wide as the motion."""
    background = np.full((100, 120), 20, np.uint8)
    background[:, 60:] = 220
    live, _ = exposed(Scene(background, 20), moving(t_x=-29.5 * 0.5, v_x=0.5), 20.0, rolling=False)
    assert (live == live[0]).all()
    ramp = live[0, 34:47].astype(float)
    slope = np.diff(ramp)[2:-2]
    np.testing.assert_allclose(slope, 200 / 10, atol=3.0)  # 20 rows x 0.5 px; uint8, splines


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
            total += naive.spline(linear, v, u) / count
        expected = to_display(np.array(total), gamma)
        assert abs(truth.clean[row, column] - expected) < 0.2  # 8 instants against 160
        assert abs(float(live[row, column]) - expected) < 0.8  # + rounding to uint8


@pytest.mark.oracle
def test_planes_are_composed_as_the_equations_say(texture_of):
    """Eq. 2 and 5 pixel by pixel: six degrees of freedom, two layers, one new object."""
    far = Sheet(texture_of(20, 24, 1), np.full((20, 24), 0.7, np.float32), 30, 10, 0.8)
    near = Sheet(texture_of(14, 14, 2), np.ones((14, 14), np.float32), 40, 18, 0.5)
    new = box(34, 22, 12, 250)
    scene = Scene(texture_of(100, 120, 3), 20, (far, near))
    timing, count = ShutterTiming(6.0), 5
    seen = expose(scene, (new,), GRID, bent, timing, 1.0, instants=count)
    ground = scene.background.astype(float)
    for row, column in ((20, 42), (24, 40), (28, 38), (33, 50), (5, 5)):
        total = 0.0
        for k in range(count):
            pose = bent(np.array([row + ((k + 0.5) / count - 0.5) * 6.0]))
            q = coordinates_from_poses(pose, GRID)[0]
            h = naive.homography(q, GRID.focal_px, GRID.half_width)
            u, v = naive.warped_place(h, column, row, GRID.center)
            value = naive.spline(ground, v + 20, u + 20)
            for sheet in (new, far, near):
                h = naive.homography(q, GRID.focal_px, GRID.half_width, sheet.relative_depth)
                u, v = naive.warped_place(h, column, row, GRID.center)
                texture = np.pad(sheet.texture.astype(float), 2, mode='edge')
                at = v - sheet.y + 2, u - sheet.x + 2
                if not (0 < at[0] < texture.shape[0] - 1 and 0 < at[1] < texture.shape[1] - 1):
                    continue
                cover = np.pad(sheet.cover, 2).astype(float)
                alpha = np.clip(naive.cubic(cover, *at, naive.keys), 0, 1)
                value += alpha * (naive.spline(texture, *at) - value)
            total += value / count
        np.testing.assert_allclose(seen.light[row, column, 0], total, rtol=1e-5)  # float32 textures


def test_result_does_not_depend_on_the_number_of_threads(scene):
    frames = [exposed(scene, bent, 12.0, objects=(box(30, 20),), threads=n) for n in (1, 2, 5)]
    for live, truth in frames[1:]:
        np.testing.assert_array_equal(live, frames[0][0])
        np.testing.assert_array_equal(truth.places, frames[0][1].places)
        np.testing.assert_array_equal(truth.objects, frames[0][1].objects)


@pytest.mark.parametrize('exposure', [0.0, 8.0])
def test_registered_image_of_the_true_path_is_the_live_image(scene, exposure):
    """With all nuisances off only the sampling differs: the estimator's against splines."""
    _, truth = exposed(scene, bent, exposure)
    fine = half_pixel(scene.background.astype(np.float32))
    counts = 40 if exposure else 1
    error = []
    for row in range(2, 58, 5):
        times = row + ((np.arange(counts) + 0.5) / counts - 0.5) * exposure
        hs = homographies(coordinates_from_poses(bent(times), GRID), GRID)
        for column in range(2, 78, 7):
            places = [naive.warped_place(h, column, row, GRID.center) for h in hs]
            values = [naive.bilinear(fine, 2 * v + 40, 2 * u + 40)[0] for u, v in places]
            error.append(np.mean(values) - truth.clean[row, column])
    rms = np.sqrt(np.mean(np.square(error)))
    assert 20 * np.log10(255 / rms) > 66.0  # dB; measured: 69.4 sharp, 71.3 blurred


def test_layer_moves_by_its_depth_and_hides_the_ground():
    roof = Sheet(np.full((12, 16), 250, np.uint8), np.ones((12, 16), np.float32), 30, 20, 0.5)
    scene = Scene(np.full((100, 120), 40, np.uint8), 20, (roof,))
    live, truth = exposed(scene, moving(t_x=-4.0), 0.0)
    reference = reference_image(scene, PLAIN, np.random.default_rng(0))
    left = [int(np.argmax(image[26] > 200)) for image in (reference, live)]
    assert left == [30, 38]  # t / d = -8: the roof lies 8 px further right in the live frame
    assert not (truth.label == CHANGED).any()
    np.testing.assert_array_equal(truth.layers == 1, live > 145)
    assert truth.depths == (0.5,)


def test_object_outside_and_rim_are_labelled():
    scene = Scene(np.full((60, 80), 90, np.uint8), 0)
    live, truth = exposed(scene, moving(t_x=-10.0, v_x=0.3), 10.0, objects=(box(40, 20),))
    assert list(truth.boxes) == ['box']
    x, y, width, height = truth.boxes['box']
    assert (y, height) == (20, 14)
    assert 39 <= x <= 42  # 40 + 10 - 0.3 * row at the last row
    assert 56 <= x + width <= 60  # 14 px wider at the first row
    assert np.all(live[truth.label == CHANGED] > 160)
    np.testing.assert_array_equal(truth.objects == 1, truth.label == CHANGED)
    assert np.all(truth.label[:8, :8] == OUTSIDE)  # starts 10 px left of the reference
    assert not np.any(truth.label[32:34, 4:-4] == OUTSIDE)  # by then it is back
    assert not np.any(live[truth.label == 0] > 90 + RIM_COVER * 165 + 1)


def test_gone_object_is_in_the_reference_and_changed_where_it_was():
    scene = Scene(np.full((100, 120), 90, np.uint8), 20)
    gone = box(40, 20, kind=GONE)
    live, truth = exposed(scene, moving(t_x=-6.0), 0.0, objects=(gone,))
    reference = reference_image(scene, PLAIN, np.random.default_rng(0), (gone,))
    assert (live == 90).all()
    np.testing.assert_array_equal(reference[20:34, 40:54], 255)
    assert truth.boxes == {'box': (46, 20, 14, 14)}
    assert (truth.clean[20:34, 46:60] == 255).all(), 'clean is the reference, seen by this camera'


def test_moved_object_changes_both_places():
    scene = Scene(np.full((100, 120), 90, np.uint8), 20)
    objects = (box(10, 20, name='is'), box(50, 20, name='was', kind=GONE))
    _, truth = exposed(scene, still, 0.0, objects=objects)
    assert truth.boxes == {'is': (10, 20, 14, 14), 'was': (50, 20, 14, 14)}


def test_shadow_darkens_and_is_neither_change_nor_none():
    scene = Scene(np.full((100, 120), 200, np.uint8), 20)
    shadow = cast_shadow(box(30, 20, side=20), 0.4)
    live, truth = exposed(scene, still, 0.0, objects=(shadow,))
    assert abs(int(live[35, 45]) - 0.6 * 200) <= 1
    assert truth.label[35, 45] == RIM
    assert not (truth.label == CHANGED).any()
    assert truth.names == ()


def test_roof_hides_the_object_below():
    roof = Sheet(np.full((30, 30), 250, np.uint8), np.ones((30, 30), np.float32), 30, 15, 0.9)
    scene = Scene(np.full((100, 120), 40, np.uint8), 20, (roof,))
    live, truth = exposed(scene, still, 0.0, objects=(box(36, 20, value=120),))
    assert not (live == 120).any()
    assert not truth.label.any()
    assert truth.names == ()


def test_objects_out_of_view_are_no_truth():
    scene = Scene(np.full((100, 120), 40, np.uint8), 20)
    objects = (box(-30, 20, name='beside'), box(30, 20, name='in view'))
    _, truth = exposed(scene, still, 0.0, objects=objects)
    assert truth.names == ('in view',)
    assert set(np.unique(truth.objects)) == {0, 1}


def test_distortion_moves_places_as_its_parameter_says():
    """Both images are distorted: with a still camera nothing moves, with a moving one it does."""
    grid = GRID
    scene = Scene(np.full((100, 120), 40, np.uint8), 20)
    _, truth = exposed(scene, still, 0.0, nuisances=Nuisances(gamma=1.0, distortion=0.05))
    y, x = np.mgrid[:60, :80]
    np.testing.assert_allclose(truth.places, np.stack([x, y], axis=2), atol=0.02)
    k, row, column = 0.05, 40, 70
    _, truth = exposed(scene, moving(t_x=5.0), 0.0, nuisances=Nuisances(gamma=1.0, distortion=k))
    point = np.array([column, row]) - grid.center[:2]
    ideal = point * (1 + k * (point @ point) / grid.half_width**2) + [5.0, 0.0]
    place = truth.places[row, column] - grid.center[2:]
    back = place * (1 + k * (place @ place) / grid.half_width**2)
    np.testing.assert_allclose(back, ideal, atol=0.02)  # four steps of the inverse


def test_centroid_of_a_row_is_the_mean_of_its_poses(scene):
    _, truth = exposed(scene, moving(v_x=0.5, t_x=2.0), 10.0)
    np.testing.assert_allclose(truth.centroids[:, 0], 2.0 + 0.5 * np.arange(60), atol=1e-9)
    assert truth.path_start == -5
    np.testing.assert_allclose(truth.path[:, 0], 2.0 + 0.5 * np.arange(-5, 65), atol=1e-9)
    hs = homographies(coordinates_from_poses(truth.centroids, GRID), GRID)
    np.testing.assert_allclose(truth.places[30, 40, 0] - 40, hs[30, 0, 2], atol=1e-3)
