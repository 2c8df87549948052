"""The true path explains what the live camera sees, and nothing else does as well."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rsmb_ros.core.motion import Grid
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, Sheet, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import SIX_DOF, blurred_by, offset, swaying_by, wobble
from rsmb_ros.evaluation.case import Case
from rsmb_ros.evaluation.suites.recipe import case_of
from rsmb_ros.evaluation.true_path import APART, path_of, plain_ground, true_prediction

NONE = Nuisances()
SHAPE, FOCAL = (100, 140), 126.0
PLACE = np.array([4.0, -3.0, 0.5, 1.005, 0.1, -0.1])
SHUTTERS = {
    'top down': ShutterTiming(20.0),
    'bottom up': ShutterTiming(20.0, bottom_up=True),
    'global': ShutterTiming(20.0, rolling=False),
    'sharp': ShutterTiming(0.0),
}


def taken(texture, timing, layers=(), objects=(), nuisances=NONE):
    """A case whose camera is known."""
    rng = np.random.default_rng(5)
    scene = Scene(texture, 30, layers)
    moving = wobble('smooth', SIX_DOF, timing, SHAPE[0], rng)
    if timing.exposure_rows:
        moving = blurred_by(moving, 6.0, timing, SHAPE[0])
    else:
        moving = swaying_by(moving, 6.0, SHAPE[0])
    path = offset(PLACE, moving)
    reference = reference_image(scene, nuisances, rng, objects)
    grid = Grid(SHAPE, SHAPE, FOCAL)
    live, truth = live_frame(scene, objects, grid, path, timing, nuisances, rng)
    return case_of('made/0', reference, live, truth, FOCAL, {})


def rmse(case, found):
    return float(np.sqrt(np.mean((found.predicted - luma(case.live))[found.where] ** 2)))


@pytest.fixture(scope='module')
def ground(texture_of):
    return cv2.GaussianBlur(texture_of(160, 200, 4), (0, 0), 1.0)


@pytest.mark.parametrize('shutter', SHUTTERS)
def test_true_path_leaves_rounding_alone(ground, shutter):
    case = taken(ground, SHUTTERS[shutter])
    found = true_prediction(case, 2.2)
    assert found.where.mean() > 0.7
    # both images are rounded, .29 each, and one is interpolated
    assert rmse(case, found) < 0.5


@pytest.mark.parametrize('shutter', SHUTTERS)
def test_path_has_the_true_centroids(ground, shutter):
    case = taken(ground, SHUTTERS[shutter])
    found = path_of(case.motion, Grid(SHAPE, SHAPE, FOCAL)).row_motion()
    np.testing.assert_allclose(found, case.motion.centroids, atol=0.02)  # px, 16 instants a row


def test_other_path_explains_less(ground):
    case = taken(ground, SHUTTERS['top down'])
    off = case.motion.path + np.array([0.5, 0, 0, 0, 0, 0])
    away = replace(case, motion=replace(case.motion, path=off))
    assert rmse(case, true_prediction(away, 2.2)) > 2 * rmse(case, true_prediction(case, 2.2))


def test_light_and_defocus_are_fitted(ground):
    colour = np.dstack([ground, 0.8 * ground + 20, 255 - 0.7 * ground]).astype(np.uint8)
    seen = Nuisances(gain=0.8, bias=3.0, vignetting=0.2, defocus_px=0.6)
    case = taken(colour, SHUTTERS['top down'], nuisances=seen)
    assert rmse(case, true_prediction(case, 2.2)) < 0.5


def test_light_adds_up_by_the_tone_curve_that_is_asked_for(texture_of):
    case = taken(texture_of(160, 200, 4), SHUTTERS['top down'])
    right, wrong = (rmse(case, true_prediction(case, gamma)) for gamma in (2.2, 1.0))
    assert wrong > 1.2 * right


def test_change_does_not_bend_the_light(ground):
    texture = np.full((50, 60), 250, np.uint8)
    thing = Sheet(texture, np.ones((50, 60), np.float32), 40.0, 30.0, name='thing', kind=1)
    case = taken(ground, SHUTTERS['top down'], objects=(thing,))
    assert case.changed
    assert rmse(case, true_prediction(case, 2.2)) < 0.5


def test_plain_ground_is_away_from_changes_and_layers():
    label, layers = np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
    label[:, 20] = 170
    layers[:, 100] = 1
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    case = taken(np.full((160, 200), 90, np.uint8), SHUTTERS['sharp'])
    motion = replace(
        case.motion, places=np.dstack([x + 8, y - 6]), layers=layers, depths=(0.8,)
    )  # 10 px, of which .25 against the ground: 3 px
    found = plain_ground(replace(case, label=label, motion=motion), motion)
    assert (found == found[0]).all()
    away = {20: APART, 100: APART + 3}
    expected = [all(abs(x - at) > by for at, by in away.items()) for x in range(SHAPE[1])]
    np.testing.assert_array_equal(found[0], expected)


def test_nobody_knows_a_real_path():
    image = np.zeros(SHAPE, np.uint8)
    assert true_prediction(Case('real/0', image, image, image, image), 2.2) is None
