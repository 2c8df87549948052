"""Rows that a violent motion has lost are found from those that fit, and from nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from row_places import row_errors

from rsmb_ros.core import Camera, Config, Detector, Result, path_stage
from rsmb_ros.core.agreement import Agreement
from rsmb_ros.core.motion import Grid, moved_px, still_path
from rsmb_ros.core.path_stage import PathStage
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.stream import RESTED
from rsmb_ros.core.sweep import STEP, _steps, _straight_on, held_rows, swept
from rsmb_ros.core.synthesis import NEW, Nuisances, Scene, Sheet, Truth, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import SIX_DOF, blurred_by, walk

SHAPE = (240, 320)
MARGIN = 160  # px, that the camera may look beyond the reference
CAMERA = Camera(300.0)
REAL = Nuisances(gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)
OFF = 2.0  # px, from which on a row is not in its place


@dataclass(frozen=True)
class Case:
    reference: np.ndarray
    live: np.ndarray
    truth: Truth
    grid: Grid


@pytest.fixture(scope='module')
def texture(texture_of):
    return texture_of(SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN, 21)


def case(texture, seed, blur=7.0, objects=(), bottom_up=False):
    """One live frame of a camera that turns every 32 rows, and moves `blur` px in 8 of them."""
    rng = np.random.default_rng(seed)
    timing = ShutterTiming(8.0, bottom_up=bottom_up)
    path = blurred_by(walk(rng, SIX_DOF, timing, SHAPE[0], 32.0), blur, timing, SHAPE[0])
    scene, grid = Scene(texture, margin=MARGIN), Grid(SHAPE, SHAPE, CAMERA.focal_px)
    reference = reference_image(scene, REAL, rng, objects)
    live, truth = live_frame(scene, objects, grid, path, timing, REAL, rng)
    return Case(reference, live, truth, grid)


def off(found: Case, result: Result) -> float:
    """Return the share of the rows whose middle is not in its place."""
    assert result.status == 'registered'
    errors = row_errors(result.row_motion, found.truth.centroids, found.grid)
    return float((errors > OFF).mean())


def detected(found: Case, depth=None, **sections) -> Result:
    config = Config.from_mapping(sections)
    return Detector(found.reference, CAMERA, config, depth).detect(found.live)


@pytest.mark.parametrize('seed', [5, 6, 8, 15])
def test_rows_that_the_start_loses_are_swept_up(texture, seed, monkeypatch):
    found = case(texture, seed)
    result = detected(found)
    assert off(found, result) < 0.02
    assert not result.changes
    assert abs(result.exposure_rows - 8.0) < 0.5
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    assert off(found, detected(found)) > 0.1


def test_little_that_is_left_of_a_frame_is_not_judged(texture, monkeypatch):
    found, much = case(texture, 8), {'registration': {'min_agreement': 0.65}}
    assert off(found, detected(found, **much)) < 0.02
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    result = detected(found, **much)
    assert result.status == 'not_registered'
    assert result.reason.startswith('path lost in 40% of the rows: in the others')
    assert np.isnan(result.row_motion).all()


def test_rows_read_bottom_up_are_swept_up(texture, monkeypatch):
    found = case(texture, 19, bottom_up=True)
    settings = {'shutter': {'readout': 'bottom_up'}}
    assert off(found, detected(found, **settings)) < 0.02
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    assert off(found, detected(found, **settings)) > 0.2


def test_rows_are_swept_up_where_the_depth_is_known(texture, monkeypatch):
    found = case(texture, 8)
    flat = np.ones(SHAPE, np.float32)
    assert off(found, detected(found, flat)) < 0.02
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    assert off(found, detected(found, flat)) > 0.1


def test_a_gust_in_a_stream_is_swept_up(texture, monkeypatch):
    calm, gust = case(texture, 9, blur=1.0), case(texture, 8)

    def second() -> Result:
        detector = Detector(calm.reference, CAMERA, Config.from_mapping({'stream.hold': True}))
        assert off(calm, detector.detect(calm.live)) == 0.0
        return detector.detect(gust.live)

    assert off(gust, second()) < 0.02
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    plain = second()
    assert plain.status == 'not_registered' or off(gust, plain) > 0.2


@pytest.mark.parametrize(('unseen', 'taken'), [(0, True), (100, False)])
def test_a_sweep_must_not_misfit_less_by_seeing_less(texture, monkeypatch, unseen, taken):
    found, frames = case(texture, 9, blur=1.0), []

    def leaving(stage, frame, _):
        frames.append(stage.refined(frame, np.zeros(SHAPE, bool), 0.0))
        frames[0].complete[:unseen] = False
        frames[0].residual *= 0.7
        return frames[0]

    monkeypatch.setattr(PathStage, 'swept', leaving)
    assert (detected(found).views is frames[0]) == taken


def test_a_large_change_is_not_swept_away(texture, texture_of, monkeypatch):
    """One that leaves ground at one side only: most of its rows counts as lost."""
    new = Sheet(texture_of(100, 270, 77), np.ones((100, 270), np.float32), 0, 40, kind=NEW)
    found = case(texture, 9, blur=1.0, objects=(new,))
    fits = []

    def watched(*args):
        fits.append(swept(*args))
        return fits[-1]

    monkeypatch.setattr(path_stage, 'swept', watched)
    result = detected(found)
    assert len(fits) == 1
    assert off(found, result) == 0.0
    assert (result.change_mask > 0)[found.truth.objects > 0].mean() > 0.85
    monkeypatch.setattr(PathStage, 'swept', lambda *_: None)
    np.testing.assert_array_equal(result.change_mask, detected(found).change_mask)


def test_a_large_change_that_stays_is_swept_in_vain_now_and_then_only(
    texture, texture_of, monkeypatch
):
    new = Sheet(texture_of(100, 270, 77), np.ones((100, 270), np.float32), 0, 40, kind=NEW)
    found = case(texture, 9, blur=1.0, objects=(new,))
    sweeps = []
    monkeypatch.setattr(path_stage, 'swept', lambda fit, *_: sweeps.append(fit) or fit)
    for hold, most in ((True, 2), (False, RESTED + 2)):
        detector = Detector(found.reference, CAMERA, Config.from_mapping({'stream.hold': hold}))
        sweeps.clear()
        for _ in range(RESTED + 2):
            assert detector.detect(found.live).status == 'registered'
        assert len(sweeps) == most


def test_any_number_of_threads_sweeps_alike(texture):
    found = case(texture, 4)
    one, three = (detected(found, worker={'threads': threads}) for threads in (1, 3))
    np.testing.assert_array_equal(one.row_motion, three.row_motion)
    np.testing.assert_array_equal(one.residual, three.residual)


def agreeing(*shares: float, blocks: int = 20) -> Agreement:
    """Return what agrees, by the share of each band; nothing is asked where it is below 0."""
    asked = np.array([[share >= 0.0] * blocks for share in shares])
    agreed = np.array([np.arange(blocks) < share * blocks for share in shares])
    return Agreement(asked, asked & agreed, 16, agreed.mean(axis=1))


@pytest.mark.parametrize(
    ('shares', 'held'),
    [
        ((1, 1, 0.7, 1, 0.4, 0.5), None),  # none is lost
        ((0, 0.1, 0.5, 0.1, 0.5, 0), None),  # nothing to start from
        ((0, 1, 0, 0, 0, 0), None),  # too few rows
        ((1, 1, 1, 1, 0, 0), (0, 56)),
        ((0, 0.5, 1, 1, 1, 0.8), (40, 100)),
        ((1, 1, 0, 0.7, 0.8, 0.9), (56, 100)),
        ((1, 0, 1, 1, 1, -1), (40, 72)),
    ],
)
def test_longest_run_of_rows_that_agree_is_held(shares, held):
    assert held_rows(agreeing(*shares), 100, 0) == held


def test_what_is_held_is_left_further_inside_where_images_are_larger():
    assert held_rows(agreeing(0, 0, 1, 1, 1, 1, 0), 112, 1) == (48, 80)


def test_steps_take_in_all_rows_from_both_sides():
    held, taken = (40, 60), []
    for known, end in _steps(held, 100, STEP):
        assert known == (min([40, *taken]), max([60, *taken]))
        taken.append(end)
    assert taken == [28, 72, 16, 84, 4, 96, 0, 100]


def test_a_path_goes_straight_on_where_no_row_holds_it():
    path = still_path(Grid(SHAPE, SHAPE, 300.0), 24.0, 8.0, 16.0, bottom_up=False)
    knots = np.arange(len(path.control), dtype=float)
    path.control[:, 0], path.control[:, 2] = 24.0 * knots, 5.0  # 1 px a row
    bent = still_path(path.grid, 24.0, 8.0, 16.0, bottom_up=False)
    bent.control[:] = path.control
    bent.control[7:] += 50.0  # far from the rows that are held
    assert moved_px(bent, path) > 50.0
    assert moved_px(_straight_on(bent, (10, 90)), path) < 0.5
    np.testing.assert_allclose(_straight_on(bent, (10, 90)).control[:, 2], 5.0, atol=0.1)
