"""The second opinion on where a frame lies: features, for frames that patches cannot place."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.features import FeatureSearch
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.synthesis import Style, aerial_scene

SHAPE = (300, 400)


@pytest.fixture(scope='module')
def ground():
    scene = aerial_scene(SHAPE, np.random.default_rng(11), 120, Style(houses=0))
    return scene.background


def turned(ground, degrees, zoom=1.0, shift=(0.0, 0.0)):
    """Return reference, live frame and the matrix that takes live pixels to reference pixels."""
    rows, cols = SHAPE
    corner = np.array([120.0, 120.0])
    center = (cols - 1) / 2, (rows - 1) / 2
    h = cv2.getRotationMatrix2D(center, degrees, zoom)
    h[:, 2] += shift
    to_ground = h.copy()
    to_ground[:, 2] += corner
    live = cv2.warpAffine(
        ground, to_ground, (cols, rows), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    )
    reference = ground[120 : 120 + rows, 120 : 120 + cols]
    return reference, live, h


def grey(image):
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)


def test_features_find_a_turned_and_shifted_frame(ground):
    reference, live, h = turned(ground, 30.0, 1.1, (60.0, -30.0))
    matches = FeatureSearch(grey(reference), Grid(SHAPE, SHAPE, 360.0)).match(grey(live))
    centre = np.array([SHAPE[1] - 1, SHAPE[0] - 1]) / 2
    places = matches.place + centre
    expected = places @ h[:, :2].T + h[:, 2] - places
    errors = np.hypot(*(matches.shift - expected).T)
    assert len(errors) > 50
    assert np.median(errors) < 0.5  # px; a feature's place is good to a fraction of a pixel


def test_detector_registers_what_only_features_can_place(ground):
    reference, live, _ = turned(ground, 30.0, 1.0, (60.0, -30.0))
    result = Detector(reference).detect(live)
    assert result.status == 'registered', result.reason
    assert 'second start' in result.timings_ms
    assert np.median(np.abs(result.row_motion[:, 2])) == pytest.approx(30.0, abs=0.3)
    assert not result.changes


def test_other_ground_is_refused_after_the_second_look(ground):
    other = aerial_scene(SHAPE, np.random.default_rng(99), 0, Style(houses=0, roads=0.0))
    reference, _, _ = turned(ground, 0.0)
    result = Detector(reference, config=Config()).detect(other.background)
    assert result.status == 'not_registered'
    assert not result.change_mask.any()


@pytest.mark.parametrize('flat', [0, 128])
def test_flat_image_has_no_features(ground, flat):
    reference, live, _ = turned(ground, 0.0)
    blank = np.full(SHAPE, flat, np.float32)
    grid = Grid(SHAPE, SHAPE, 360.0)
    assert FeatureSearch(blank, grid).match(grey(live)) is None
    assert FeatureSearch(grey(reference), grid).match(blank) is None
