"""Rows one by one: frames of known motion in, poses out."""

from __future__ import annotations

import naive_rows
import numpy as np
import pytest

from rsmb_ros.core.coarse import CoarseSearch
from rsmb_ros.core.errors import ConfigError, FrameError
from rsmb_ros.core.motion import Grid, coordinates_from_poses
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.row_estimator import RowEstimator
from rsmb_ros.core.row_fit import AROUND_NEIGHBOUR, AROUND_START, RowFit
from rsmb_ros.core.sampling import half_pixel
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.start import start_path
from rsmb_ros.core.synthesis import Nuisances, Scene, Sheet, aerial_scene, live_frame
from rsmb_ros.core.synthesis.paths import POSE_ZERO, offset, smooth, stairs
from rsmb_ros.core.workers import Workers

SHAPE = (256, 384)  # the authors' size
PER_EXPOSURE, PER_ROW = 20, 3  # a, b of the ECCV 2014 recipe
LINEAR = Nuisances(gamma=1.0)  # display values add up: the report's model
NO_MOTION = np.zeros(6)


class Frame:
    """A live frame of a scene, with a start a pixel off."""

    def __init__(self, scene, path, timing, instants=None, objects=()):
        grid = Grid(scene.shape, scene.shape, 0.9 * scene.shape[1])
        inner = np.s_[scene.margin : -scene.margin]
        self.grid = grid
        self.reference = luma(scene.background[inner, inner])
        rng = np.random.default_rng(1)
        live, self.truth = live_frame(
            scene, objects, grid, path, timing, LINEAR, rng, instants=instants
        )
        self.live = luma(live)
        self.start = np.tile(self.truth.centroids.mean(axis=0), (grid.live_shape[0], 1))
        self.start[:, :2] += [0.8, -0.7]

    def coarse_start(self) -> np.ndarray:
        """Start as the detector has it; on small frames its zoom is not good enough for this."""
        exposure = self.truth.exposure_rows
        matches = CoarseSearch(self.reference, self.grid, 0.3, Workers(1)).match(self.live)
        path = start_path(matches, self.grid, 24.0, exposure, exposure + 8.0, bottom_up=False)
        return path.row_motion()

    def fit(self, executor, **options) -> RowFit:
        estimator = RowEstimator(self.reference, self.grid, executor, **options)
        return estimator.estimate(self.live, self.start)

    def errors(self, fit: RowFit) -> np.ndarray:
        """Root mean square error of each component over all rows, interpolated ones too."""
        return np.sqrt(np.mean((fit.centroids - self.truth.centroids) ** 2, axis=0))


def smooth_stairs(seed: int, amplitude, shape=SHAPE):
    """Nonuniform motion of the ECCV recipe; an exposure takes 20 of some 800 poses."""
    rng = np.random.default_rng(seed)
    path = smooth(rng, np.asarray(amplitude, float), 0.8 * shape[0])
    steps = (shape[0] - 1) * PER_ROW + PER_EXPOSURE
    poses = path((np.arange(steps) - 0.5 * (PER_EXPOSURE - 1)) / PER_ROW)
    return stairs(poses, PER_ROW, PER_EXPOSURE)


def recipe_frame(seed: int, amplitude) -> Frame:
    scene = aerial_scene(SHAPE, np.random.default_rng(seed), margin=60)
    scene = Scene(scene.background, scene.margin)  # the ground alone: planar
    timing = ShutterTiming(PER_EXPOSURE / PER_ROW)
    frame = Frame(scene, smooth_stairs(seed, amplitude), timing, PER_EXPOSURE)
    frame.start = frame.coarse_start()
    return frame


def textured_frame(texture_of, path, timing, shape=(60, 160), objects=()) -> Frame:
    background = texture_of(shape[0] + 40, shape[1] + 40, 11)
    return Frame(Scene(background, 20), path, timing, objects=objects)


@pytest.fixture(scope='module')
def shaken(texture_of):
    """A small blurred frame that sways by some pixels and half a degree."""
    path = smooth(np.random.default_rng(3), np.array([5, 4, 0.5, 0, 0, 0]), 70.0)
    return textured_frame(texture_of, path, ShutterTiming(8.0))


def test_sizes_of_the_pose_spaces_are_the_authors():
    sizes = [len(AROUND_NEIGHBOUR.first(degrees).offsets()) for degrees in (2, 3, 6)]
    assert sizes == [49, 245, 6615]
    for space in (AROUND_NEIGHBOUR, AROUND_START):
        offsets = space.first(3).offsets()
        np.testing.assert_array_equal(offsets[len(offsets) // 2], NO_MOTION)
        np.testing.assert_allclose(offsets.max(axis=0), [*space.bounds[:3], 0, 0, 0])


@pytest.mark.oracle
@pytest.mark.parametrize('depth', [1.0, 0.7])
def test_rendered_rows_are_weighted_sums_of_warped_rows(texture_of, depth):
    rng = np.random.default_rng(9)
    grid = Grid((12, 30), (16, 34), 40.0)
    fine = half_pixel(texture_of(16, 34, 9).astype(np.float32))
    poses = rng.normal([0, 0, 0, 1, 0, 0], [2, 2, 2, 0.02, 1, 1], (12, 3, 6))
    weights = rng.dirichlet(np.ones(3), 12)
    weights[4, 1] = 0.0
    chi = np.zeros((12, 30), np.float32)
    fit = RowFit(grid, poses, weights, np.ones(12, bool), chi, poses[:, 0])
    image, complete = fit.render(fine, depth)
    assert 0.3 < complete.mean() < 1.0
    for i in (0, 4, 7, 11):
        expected = sum(
            w * naive_rows.warped_row(fine, i, pose, range(30), grid.center, 40.0, depth)
            for pose, w in zip(poses[i], weights[i], strict=True)
            if w > 0
        )
        known = ~np.isnan(expected)
        np.testing.assert_array_equal(complete[i], known)
        np.testing.assert_allclose(image[i][known], expected[known], atol=2e-3)  # float32
        assert not image[i][~known].any()


@pytest.mark.parametrize('degrees', [2, 3])
def test_motion_is_found_as_well_as_the_authors_find_it(executor, degrees):
    """Their bar, nonuniform t_x, t_y, the mean over their pictures: 0.18 and 0.14 px."""
    errors = []
    for seed in range(1, 9):
        frame = recipe_frame(seed, [8, 8, 0, 0, 0, 0])
        fit = frame.fit(executor, degrees_of_freedom=degrees)
        assert np.ptp(frame.truth.centroids, axis=0)[:2].max() > 5  # px: it does move
        assert fit.solved.mean() > 0.7  # the others are homogeneous
        errors.append(frame.errors(fit))
    assert np.mean(errors, axis=0)[0] < 0.18
    assert np.mean(errors, axis=0)[1] < 0.14


def test_rotation_is_found_with_three_degrees_of_freedom(executor):
    frame = recipe_frame(4, [6, 6, 0.8, 0, 0, 0])
    error = frame.errors(frame.fit(executor))
    assert np.all(error[:2] < 0.3)  # px
    assert error[2] < 0.1  # deg: a third of a pixel at the edge


def test_registered_image_is_the_live_one(shaken, executor):
    fit = shaken.fit(executor)
    fine = half_pixel(shaken.reference)
    registered, complete = fit.render(fine, executor=executor)
    assert complete.mean() > 0.75
    misfit = (registered - shaken.live)[complete]
    assert np.sqrt(np.mean(misfit**2)) < 1.75  # the report's, in grey levels
    assert not fit.chi[~complete].any()
    alone, _ = fit.render(fine)
    np.testing.assert_array_equal(alone, registered)


def test_weights_are_shares_of_the_exposure(shaken, executor):
    fit = shaken.fit(executor)
    assert np.all(fit.weights >= 0)
    assert np.all(fit.weights.max(axis=0) > 0)  # padded to the largest count, no further
    # |w|_1 has a weight, so the sum is a little less than the gain, which is 1
    np.testing.assert_allclose(fit.weights.sum(axis=1), 1.0, atol=0.05)
    centroids = np.einsum('ik,ike->ie', fit.weights, fit.poses)
    centroids /= fit.weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(centroids, fit.centroids, atol=1e-9)


def test_six_degrees_of_freedom_place_the_image_centre(texture_of, executor):
    """Pose by pose they are ambiguous (R_x against t_y); where the centre goes is not."""
    path = smooth(np.random.default_rng(6), np.array([3, 3, 0.3, 0, 0.1, 0.1]), 60.0)
    frame = textured_frame(texture_of, path, ShutterTiming(5.0), (36, 120))
    fit = frame.fit(executor, degrees_of_freedom=6)
    inner = slice(4, -4)  # farther out some of the poses see beyond the reference
    found, truth = (
        coordinates_from_poses(poses[inner], frame.grid)
        for poses in (fit.centroids, frame.truth.centroids)
    )
    assert fit.solved.mean() > 0.7
    assert np.all(np.sqrt(np.mean((found - truth)[:, :2] ** 2, axis=0)) < 0.15)  # px


def test_still_camera_is_at_pose_zero(texture_of, executor):
    still = np.tile(POSE_ZERO, (60, 1))
    image = texture_of(60, 160, 12).astype(np.float32)
    fit = RowEstimator(image, Grid((60, 160), (60, 160), 150.0), executor).estimate(image, still)
    assert fit.solved.mean() > 0.95
    # a smooth row tells its place so well while its misfit stays below delta = 3.9 grey levels
    np.testing.assert_allclose(fit.centroids[:, :2], 0.0, atol=0.2)  # px
    np.testing.assert_allclose(fit.centroids[:, 2], 0.0, atol=0.25)  # deg, half a step


def test_global_shutter_gives_all_rows_the_same_pose(texture_of, executor):
    place = np.array([2.4, -1.7, 0.3, 1.0, 0.0, 0.0])
    frame = textured_frame(texture_of, offset(place), ShutterTiming(0.0, rolling=False))
    fit = frame.fit(executor)
    assert fit.solved.mean() > 0.9
    assert np.all(fit.centroids[fit.solved].std(axis=0)[:2] < 0.1)  # px
    assert np.all(frame.errors(fit)[:2] < 0.15)


@pytest.mark.parametrize('noise', [0.0, 1.0])
def test_flat_image_solves_no_row(shaken, executor, noise):
    rng = np.random.default_rng(7)
    flat = (90 + rng.normal(0, noise, shaken.live.shape)).astype(np.float32)
    fit = RowEstimator(shaken.reference, shaken.grid, executor).estimate(flat, shaken.start)
    assert not fit.solved.any()
    np.testing.assert_array_equal(fit.centroids, shaken.start)
    np.testing.assert_array_equal(fit.poses[:, 0], shaken.start)
    other = RowEstimator(flat, shaken.grid, executor).estimate(shaken.live, shaken.start)
    assert not other.solved.any()


def test_foreign_image_solves_few_rows(texture_of, shaken, executor):
    rows, cols = shaken.live.shape
    foreign = texture_of(rows, cols, 99).astype(np.float32)
    fit = RowEstimator(shaken.reference, shaken.grid, executor).estimate(foreign, shaken.start)
    assert fit.solved.mean() < 0.25
    assert np.all(np.isfinite(fit.chi))


def test_frame_beside_the_reference_solves_nothing(shaken, executor):
    away = shaken.start + np.array([500, 0, 0, 0, 0, 0])
    fit = RowEstimator(shaken.reference, shaken.grid, executor).estimate(shaken.live, away)
    assert not fit.solved.any()
    assert not fit.chi.any()


def test_homogeneous_rows_are_interpolated(shaken, executor):
    live = shaken.live.copy()
    live[40:46] = live[40:46].mean()
    fit = RowEstimator(shaken.reference, shaken.grid, executor).estimate(live, shaken.start)
    assert not fit.solved[40:46].any()
    assert fit.solved[39]
    assert fit.solved[46]
    error = fit.centroids[40:46] - shaken.truth.centroids[40:46]
    assert np.abs(error[:, :2]).max() < 0.3  # px: the sway bends little in 6 rows


def test_change_stands_out_and_leaves_the_motion_alone(texture_of, executor):
    path = smooth(np.random.default_rng(3), np.array([5, 4, 0.3, 0, 0, 0]), 70.0)
    board = np.indices((24, 40)).sum(axis=0) // 4 % 2 * 200 + 25
    new = Sheet(board.astype(np.uint8), np.ones((24, 40), np.float32), 60, 20, name='board', kind=1)
    frame = textured_frame(texture_of, path, ShutterTiming(8.0), objects=(new,))
    fit = frame.fit(executor)
    changed = frame.truth.label == 255
    assert changed.any()
    assert np.all(frame.errors(fit)[:2] < 0.3)
    assert np.median(np.abs(fit.chi[changed])) > 20  # grey levels
    assert np.mean(np.abs(fit.chi[frame.truth.label == 0]) > 4) < 0.05


def test_reference_may_be_larger_than_the_live_frame(texture_of, executor):
    reference = texture_of(100, 220, 13).astype(np.float32)
    live = reference[23:73, 40:190].copy()  # 2 px above, 5 px right of the middle
    place = np.array([5.0, -2.0, 0, 1, 0, 0])
    grid = Grid((50, 150), (100, 220), 150.0)
    start = np.tile(place + np.array([1.0, 0.6, 0, 0, 0, 0]), (50, 1))
    fit = RowEstimator(reference, grid, executor).estimate(live, start)
    assert fit.solved.all()
    np.testing.assert_allclose(fit.centroids[:, :2] - place[:2], 0.0, atol=0.2)


def test_osqp_finds_the_same_motion(texture_of, executor):
    pytest.importorskip('osqp')
    path = smooth(np.random.default_rng(3), np.array([3, 3, 0, 0, 0, 0]), 40.0)
    frame = textured_frame(texture_of, path, ShutterTiming(4.0), (24, 100))
    ours, theirs = (
        frame.fit(executor, degrees_of_freedom=2, solver=solver)
        for solver in ('active_set', 'osqp')
    )
    np.testing.assert_array_equal(ours.solved, theirs.solved)
    np.testing.assert_allclose(ours.centroids, theirs.centroids, atol=1e-3)  # px


def test_result_depends_on_neither_run_nor_threads(shaken):
    fits = []
    for threads in (1, 2, 2):
        with Workers(threads) as executor:
            fits.append(shaken.fit(executor))
    for other in fits[1:]:
        for name in ('poses', 'weights', 'solved', 'chi', 'centroids'):
            np.testing.assert_array_equal(getattr(other, name), getattr(fits[0], name))


def test_unknown_options_are_refused(shaken, executor):
    grid = shaken.grid
    with pytest.raises(ConfigError, match=r'degrees_of_freedom = 4 .* one of \(2, 3, 6\)'):
        RowEstimator(shaken.reference, grid, executor, degrees_of_freedom=4)
    with pytest.raises(ConfigError, match="solver = 'slow'"):
        RowEstimator(shaken.reference, grid, executor, solver='slow')
    with pytest.raises(FrameError, match=r'\(59, 160\) but the grid expects \(60, 160\)'):
        RowEstimator(shaken.reference[1:], grid, executor)
