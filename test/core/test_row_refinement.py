"""Rows are followed where they shake faster than the knots, and only there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import naive
import numpy as np
import pytest
from row_places import row_errors

from rsmb_ros.core import Camera, Config, Detector, loose_ends
from rsmb_ros.core import row_refinement as refinement
from rsmb_ros.core._kernels.row_shift import TERMS, row_sums
from rsmb_ros.core.frame import PathFrame
from rsmb_ros.core.loose_ends import loose_rows, mended
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.path_estimator import PathEstimator
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.points import LiveImage
from rsmb_ros.core.reference import Reference
from rsmb_ros.core.row_signal import SMOOTH, row_signal, second_half, smooth_shifts
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, Sheet, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import jello, offset, smooth

SHAPE = (240, 320)
CAMERA = Camera(300.0)
REAL = Nuisances(gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)
PLACE = np.array([6.0, -4.0, 0.5, 1.004, 0.0, 0.0])
SWAY = np.array([3.0, 3.0, 0.1, 0.002, 0.0, 0.0])  # px, px, deg, 1, deg, deg


@dataclass(frozen=True)
class Case:
    reference: np.ndarray
    live: np.ndarray
    truth: object
    grid: Grid


def case(texture, vibration=0.0, period=20.0, exposure=2.0, slow=240.0, layers=(), bottom_up=False):
    """One live frame that sways slowly and vibrates by `vibration` px, `period` rows a turn."""
    scene = Scene(texture, margin=40, layers=layers)
    grid = Grid(SHAPE, SHAPE, CAMERA.focal_px)
    rng = np.random.default_rng(42)
    shake = np.array([vibration, 0.6 * vibration, 0.02 * vibration, 0.0, 0.0, 0.0])
    path = offset(PLACE, smooth(rng, SWAY, slow), jello(rng, shake, period))
    reference = reference_image(scene, REAL, rng)
    timing = ShutterTiming(exposure, bottom_up=bottom_up)
    live, truth = live_frame(scene, (), grid, path, timing, REAL, rng)
    return Case(reference, live, truth, grid)


def detected(found: Case, depth=None, **registration):
    """Return the result with the rows refined, unless said otherwise, and layers not searched."""
    shutter = {
        'exposure_rows': registration.pop('exposure_rows', 0.0),
        'readout': registration.pop('readout', 'top_down'),
    }
    sections = {'registration': registration, 'shutter': shutter, 'layers': {'enabled': False}}
    config = Config.from_mapping(sections)
    return Detector(found.reference, CAMERA, config, depth).detect(found.live)


def errors(found: Case, result) -> np.ndarray:
    """Distance between found and true place of the middle of each row (M,) [px]."""
    return row_errors(result.row_motion, found.truth.centroids, found.grid)


def equal(one, other) -> bool:
    return np.array_equal(one.row_motion, other.row_motion) and np.array_equal(
        one.registered, other.registered
    )


@pytest.fixture(scope='module')
def texture(texture_of):
    return texture_of(SHAPE[0] + 80, SHAPE[1] + 80, 21)


@pytest.fixture(scope='module')
def roofs(texture_of):
    """Two houses, a fifth of the flying height tall."""
    cover = np.ones((70, 90), np.float32)
    return tuple(
        Sheet(texture_of(70, 90, 5 + n), cover, x, y, 0.8, f'roof {n}')
        for n, (x, y) in enumerate([(40.0, 30.0), (190.0, 120.0)])
    )


@pytest.fixture
def always_tried(monkeypatch):
    """Try denser knots on every frame: the held-out columns alone must keep them out."""
    monkeypatch.setattr(refinement, 'MIN_SIGNAL', -np.inf)


@pytest.mark.parametrize('degrees_of_freedom', [4, 6])
@pytest.mark.parametrize('exposure_rows', [0.0, 2.0])
def test_vibration_faster_than_the_knots_is_followed(texture, degrees_of_freedom, exposure_rows):
    found = case(texture, vibration=1.5)
    known = {'degrees_of_freedom': degrees_of_freedom, 'exposure_rows': exposure_rows}
    without = detected(found, refine_rows=False, **known)
    result = detected(found, **known)
    assert np.median(errors(found, without)) > 0.5  # knots of 24 rows, a turn takes 20
    assert np.median(errors(found, result)) < 0.1
    assert np.percentile(errors(found, result), 90) < 0.25
    # what is said of the error is of its size
    assert 0.3 < np.median(errors(found, result)) / np.median(result.row_uncertainty) < 3.0


def test_exposure_that_was_smeared_over_the_vibration_is_found_again(texture):
    found = case(texture, vibration=1.5, exposure=2.0)
    assert detected(found, refine_rows=False).exposure_rows > 20.0
    assert detected(found).exposure_rows < 8.0  # 0.5 px a row: 3 px of blur at most


def test_rows_read_bottom_up_are_followed(texture):
    found = case(texture, vibration=1.5, period=26.0, bottom_up=True)
    result = detected(found, readout='bottom_up')
    assert np.median(errors(found, detected(found, refine_rows=False, readout='bottom_up'))) > 0.5
    assert np.median(errors(found, result)) < 0.1


def test_frame_refused_for_its_vibration_is_registered(texture):
    found = case(texture, vibration=9.0, period=40.0, exposure=0.5)  # up to 1.4 px a row
    assert detected(found, refine_rows=False).status == 'not_registered'
    result = detected(found)
    assert result.status == 'registered'
    assert np.median(errors(found, result)) < 0.1


def test_shaking_that_the_first_start_cannot_follow_is_found_by_another(texture):
    """Which of them the first start follows is chance: strips match or do not."""
    second = 0
    for vibration in (12.0, 13.0, 14.0, 15.0, 16.0):  # up to 2.1 px a row
        found = case(texture, vibration, period=48.0, exposure=0.5)
        result = detected(found)
        assert result.status == 'registered', vibration
        assert np.median(errors(found, result)) < 0.15
        second += 'second start' in result.timings_ms
    assert second > 0


def test_no_start_registers_what_does_not_match(texture, texture_of):
    found = case(texture)
    other = replace(found, reference=texture_of(*SHAPE, 77))
    assert detected(other).status == 'not_registered'


@pytest.mark.parametrize('exposure', [0.0, 12.0, 40.0])
def test_smooth_frame_is_left_byte_equal(texture, always_tried, exposure):
    found = case(texture, exposure=exposure)
    assert equal(detected(found), detected(found, refine_rows=False))


def test_weak_texture_is_left_byte_equal(texture, always_tried):
    faint = np.rint(120 + 0.1 * (texture.astype(float) - 120)).astype(np.uint8)
    found = case(faint, exposure=8.0)
    without = detected(found, refine_rows=False)
    assert without.status == 'registered'
    assert equal(detected(found), without)


def test_houses_do_not_bend_the_rows_to_themselves(texture, roofs, always_tried):
    found = case(texture, exposure=10.0, layers=roofs)
    assert equal(detected(found), detected(found, refine_rows=False))


def test_vibration_over_known_depths_is_followed(texture, roofs):
    found = case(texture, vibration=1.5, layers=roofs)
    depth = np.ones(SHAPE, np.float32)
    for roof in roofs:
        height, width = roof.cover.shape
        depth[int(roof.y) :, int(roof.x) :][:height, :width] = roof.relative_depth
    result = detected(found, depth)
    assert np.median(errors(found, detected(found, depth, refine_rows=False))) > 0.5
    assert np.median(errors(found, result)) < 0.1


def test_exposure_longer_than_the_knots_is_never_tried(texture, always_tried, monkeypatch):
    monkeypatch.setattr(refinement, 'DENSER', ((2, -np.inf),))  # whatever is tried is taken
    for exposure, taken in ((12.0, True), (30.0, False)):
        found = case(texture, exposure=exposure)
        result = detected(found, exposure_rows=exposure)
        without = detected(found, exposure_rows=exposure, refine_rows=False)
        assert equal(result, without) is not taken


def test_knots_that_are_dense_already_are_kept(texture, always_tried):
    found = case(texture, vibration=1.5)
    dense = {'knot_rows': 6.0, 'exposure_rows': 2.0}
    assert equal(detected(found, **dense), detected(found, refine_rows=False, **dense))


# the signal of single rows


@pytest.fixture
def image(texture_of):
    return texture_of(120, 160, 8).astype(np.float32)


def residual_of(image, shift, noise=0.5):
    """Return live - predicted where row i shows what lies `shift[i]` (x, y) further on."""
    g_y, g_x = np.gradient(image)
    rng = np.random.default_rng(3)
    moved = g_x * shift[:, :1] + g_y * shift[:, 1:] + rng.normal(0, noise, image.shape)
    return moved.astype(np.float32)


def test_shifts_of_rows_are_measured(image, executor):
    i = np.arange(120)
    shift = 0.3 * np.stack([np.sin(i / 4), np.cos(i / 4)], axis=1)  # a turn takes 25 rows
    signal = row_signal(image, residual_of(image, shift), np.ones(image.shape, bool), executor)
    assert signal.share > 0.4
    assert np.abs(signal.shift - shift)[2:-2].max() < 0.03


def test_noise_is_no_signal(image, executor):
    residual = residual_of(image, np.zeros((120, 2)), noise=4.0)
    signal = row_signal(image, residual, np.ones(image.shape, bool), executor)
    assert signal.share < 0.25 * refinement.MIN_SIGNAL


def test_shift_of_one_half_of_the_columns_is_no_signal(image, executor):
    shift = 0.3 * np.stack([np.sin(np.arange(120) / 4)] * 2, axis=1)
    half = second_half(np.arange(160), 160)
    residual = np.where(half, residual_of(image, shift), residual_of(image, -shift))
    signal = row_signal(image, residual.astype(np.float32), np.ones(image.shape, bool), executor)
    assert signal.share < 0.0


def test_frame_of_which_nothing_is_judged_has_no_signal(image, executor):
    signal = row_signal(image, np.zeros_like(image), np.zeros(image.shape, bool), executor)
    assert signal.share == 0.0
    assert not signal.shift.any()


@pytest.mark.oracle
def test_sums_of_rows_are_the_normal_equations_of_their_shifts(image):
    rng = np.random.default_rng(4)
    image = image[:12, :50]
    residual = rng.normal(0, 3, image.shape).astype(np.float32)
    judged = rng.uniform(size=image.shape) > 0.2
    ends = np.array([13, 30, 31, 50])
    sums = np.zeros((12, 2, TERMS), np.float32)
    limits = np.float32(4.0), np.float32(0.01), np.float32(9.0)
    row_sums(0, 12, image, residual, judged, ends, *limits, sums)
    expected = naive.row_sums(image, residual, judged, ends, *limits)
    np.testing.assert_allclose(sums, expected, rtol=2e-5, atol=1e-4)  # float32


def test_smooth_shifts_solve_the_dense_system():
    rng = np.random.default_rng(5)
    rows = 9
    jacobians = rng.normal(0, 30, (rows, 20, 2))
    normal = np.einsum('npi,npj->nij', jacobians, jacobians)
    target = rng.normal(0, 100, (rows, 2))
    sums = np.zeros((rows, TERMS))
    sums[:, 0], sums[:, 1], sums[:, 2] = normal[:, 0, 0], normal[:, 0, 1], normal[:, 1, 1]
    sums[:, 3:5] = target
    bend = np.diff(np.eye(rows), 2, axis=0)
    dense = SMOOTH * np.kron(bend.T @ bend + 1e-6 * np.eye(rows), np.eye(2))
    for n in range(rows):
        dense[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] += normal[n]
    expected = np.linalg.solve(dense, target.ravel()).reshape(rows, 2)
    np.testing.assert_allclose(smooth_shifts(sums), expected, rtol=1e-8)


@pytest.mark.parametrize('end', [0, -1])
@pytest.mark.parametrize('knots', [3, 4])
@pytest.mark.parametrize('swing', [(0.0, 60.0), (2.0, 60.0), (4.0, 90.0)])  # px, rows
def test_an_end_that_slid_away_is_followed_anew(texture, executor, end, knots, swing):
    found = case(texture, *swing)
    reference = Reference(found.reference, 2.2)
    estimator = PathEstimator(reference, found.grid, Config(), executor)
    right = Detector(found.reference, CAMERA).detect(found.live).views
    live = LiveImage(right.grey, 2.2)

    def build(fit):
        return PathFrame(reference, found.live, right.grey, fit, executor)

    assert mended(right, live, estimator, build) is right, 'nothing is loose'
    control = right.path.control.copy()
    control[slice(0, knots) if end == 0 else slice(-knots, None), :2] += 8.0
    slid = build(replace(right.fit, path=replace(right.path, control=control), cost=9.0))
    assert errors(found, slid)[end] > 1.9
    again = mended(slid, live, estimator, build)
    assert errors(found, again)[end] < 0.6
    assert np.median(errors(found, again)) < 0.1


@pytest.mark.parametrize('end', [0, -1])
def test_an_end_that_does_not_come_back_is_lost(texture, executor, monkeypatch, end):
    found = case(texture, 2.0, 60.0)
    reference = Reference(found.reference, 2.2)
    right = Detector(found.reference, CAMERA).detect(found.live).views

    def build(fit):
        return PathFrame(reference, found.live, right.grey, fit, executor)

    control = right.path.control.copy()
    outwards = slice(0, 5) if end == 0 else slice(-5, None)
    control[outwards, :2] += 30.0 if end == 0 else -30.0  # stays in the reference
    slid = build(replace(right.fit, path=replace(right.path, control=control)))
    monkeypatch.setattr(loose_ends, '_anew', lambda *_: None)
    estimator = PathEstimator(reference, found.grid, Config(), executor)
    frame = mended(slid, LiveImage(right.grey, 2.2), estimator, build)
    error = errors(found, slid)
    assert error[end] > 5.0
    lost = np.isinf(frame.row_uncertainty)
    assert lost[end]
    assert lost[error > 3.0].mean() > 0.8
    assert not lost[error < 0.3].any()


def test_an_end_that_something_new_covers_stays_where_it_is(texture, executor):
    found = case(texture)
    right = Detector(found.reference, CAMERA).detect(found.live).views
    live = found.live.copy()
    rng = np.random.default_rng(8)
    live[200:, 40:300] = rng.integers(60, 200, live[200:, 40:300].shape)
    grey = luma(live)
    reference = Reference(found.reference, 2.2)
    estimator = PathEstimator(reference, found.grid, Config(), executor)

    def build(fit):
        return PathFrame(reference, live, grey, fit, executor)

    covered = build(right.fit)
    assert loose_rows(covered)[-1]
    assert mended(covered, LiveImage(grey, 2.2), estimator, build) is covered
