"""The tone curve that is found is the one the frames were made by."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core import REGISTERED, Camera, Config, Detector
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import SIX_DOF, blurred_by, offset, swaying_by, wobble
from rsmb_ros.core.tone import HELD_AFTER, USUAL, ToneSearch
from rsmb_ros.core.types import Result

SHAPE, FOCAL = (160, 220), 200.0
ESTIMATED = Config.from_mapping({'camera.gamma': 0})


@pytest.fixture(scope='module')
def taken(texture_of):
    """Reference and live frame of a camera: ``taken(gamma, blur_px, frames, sharpening)``."""

    def take(gamma, blur_px=8.0, frames=1, sharpening=0.0):
        rng = np.random.default_rng(3)
        colour = [np.roll(texture_of(240, 300, 9), 3 * n, axis=1) for n in range(3)]
        scene = Scene(np.dstack(colour), 40)
        camera = Nuisances(
            gain=1.1, noise_electrons=8000, jpeg_quality=92, gamma=gamma, sharpening=sharpening
        )
        reference = reference_image(scene, camera, rng)
        grid = Grid(SHAPE, SHAPE, FOCAL)
        timing = ShutterTiming(25.0 if blur_px else 0.0)
        lives = []
        for _ in range(frames):
            moving = wobble('smooth', SIX_DOF, timing, SHAPE[0], rng)
            if blur_px:
                moving = blurred_by(moving, blur_px, timing, SHAPE[0])
            else:
                moving = swaying_by(moving, 5.0, SHAPE[0])
            path = offset(np.array([4.0, -3.0, 0.3, 1.0, 0.0, 0.0]), moving)
            lives.append(live_frame(scene, (), grid, path, timing, camera, rng)[0])
        return reference, lives

    return take


def detector(reference, **changes):
    return Detector(reference, Camera(FOCAL), ESTIMATED.replaced(changes))


@pytest.mark.parametrize('gamma', [1.0, 1.8, 2.2, 2.4])
def test_blurred_frame_tells_its_curve(taken, gamma):
    reference, (live,) = taken(gamma)
    found = detector(reference)
    result = found.detect(live)
    assert result.status == REGISTERED
    assert found.gamma == pytest.approx(gamma, abs=0.3)
    given = Config.from_mapping({'camera.gamma': found.gamma})
    again = Detector(reference, Camera(FOCAL), given).detect(live)
    np.testing.assert_array_equal(result.residual, again.residual)


@pytest.mark.parametrize('sharpening', [0.2, 0.4])
def test_some_sharpening_is_not_taken_for_another_curve(taken, sharpening):
    reference, (live,) = taken(2.2, sharpening=sharpening)
    found = detector(reference)
    found.detect(live)
    assert found.gamma == pytest.approx(2.2, abs=0.3)


def test_estimated_curve_explains_more_than_the_usual_one(taken):
    reference, (live,) = taken(1.0)

    def left(config):
        result = Detector(reference, Camera(FOCAL), config).detect(live)
        return float(np.mean(result.residual[result.valid_mask > 0] ** 2))

    usual, estimated = left(Config()), left(ESTIMATED)
    assert estimated < 0.8 * usual
    assert estimated < 1.1 * left(Config.from_mapping({'camera.gamma': 1.0}))


def test_sharp_frame_tells_nothing(taken):
    reference, (live,) = taken(1.0, blur_px=0.0)
    found = detector(reference)
    assert found.detect(live).status == REGISTERED
    assert found.gamma == USUAL


def test_frames_stand_alone_unless_they_are_a_stream(taken):
    reference, lives = taken(1.4, frames=2)
    found = detector(reference)
    found.detect(lives[0])
    second = found.detect(lives[1])
    alone = detector(reference).detect(lives[1])
    np.testing.assert_array_equal(second.residual, alone.residual)


def test_stream_asks_its_first_frames_and_holds_their_median(monkeypatch):
    told = iter([1.8, None, 2.0, 1.9, 1.7, 2.6])
    asked = []
    monkeypatch.setattr('rsmb_ros.core.tone.estimated_gamma', lambda *_: next(told))
    monkeypatch.setattr('rsmb_ros.core.tone.PathFrame', object)

    def detect(live):
        asked.append(live)
        blank = np.zeros((2, 2), np.uint8)
        return Result('', '', *[blank] * 5, (), 1.0, 1.0, {}, None)

    search = ToneSearch(np.zeros((2, 2), np.uint8), True, detect)
    found = [search.gamma_for(n) for n in range(10)]
    assert found[:6] == pytest.approx([1.8, 1.8, 1.9, 1.9, 1.85, 1.9])
    assert found[6:] == found[5:6] * 4
    assert asked == list(range(HELD_AFTER + 1))  # one of them told nothing


def test_frame_that_is_not_registered_is_met_with_the_usual_curve(taken, texture_of):
    reference, _ = taken(1.8)
    found = detector(reference)
    assert found.detect(np.dstack([texture_of(*SHAPE, 77)] * 3)).status != REGISTERED
    assert found.gamma == USUAL


def test_rows_add_up_intensities_and_ask_for_no_curve(taken):
    reference, _ = taken(1.8)
    rows = {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 3}
    assert detector(reference, **rows)._tones is None


@pytest.mark.parametrize('gamma', [0.5, 0.99])
def test_curves_below_1_are_refused(gamma):
    with pytest.raises(ConfigError, match=r'camera\.gamma = .* must be 0 \(estimated\) or 1 to 3'):
        Config.from_mapping({'camera.gamma': gamma})
