"""Keypoints and corners find a homography, and say so when they do not."""

import numpy as np
import pytest

from rsmb_ros.evaluation.methods import NotRegistered
from rsmb_ros.evaluation.rivals.features import (
    HomographyRegistrar,
    Pairs,
    check_agreement,
    check_outline,
    robust_homography,
    tracked_corners,
)
from rsmb_ros.evaluation.warping import mapped


@pytest.mark.parametrize('kind', ['orb', 'sift'])
def test_a_homography_is_found(kind, homography_pair, homography_places, place_error):
    found = HomographyRegistrar(kind).register(*homography_pair, None)
    assert place_error(found, homography_places) < 0.3  # px


@pytest.mark.parametrize('kind', ['orb', 'sift'])
def test_a_strong_turn_is_found(kind, reference, places_under, taken, place_error):
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, -s, 60.0], [s, c, -40.0], [0, 0, 1]])
    places = places_under(np.broadcast_to(turn, (240, 3, 3)))
    live = taken(reference, places).astype(np.float32)
    found = HomographyRegistrar(kind).register(reference.astype(np.float32), live, None)
    assert place_error(found, places) < 0.5  # px, fewer keypoints


def test_tracks_lie_on_the_homography(homography_pair, homography):
    pairs = tracked_corners(*homography_pair)
    assert len(pairs) > 200
    error = np.linalg.norm(mapped(homography, *pairs.live.T) - pairs.reference, axis=1)
    assert np.median(error) < 0.1  # px


def test_too_few_matches_are_counted():
    pairs = Pairs(np.zeros((5, 2)), np.zeros((5, 2)))
    with pytest.raises(NotRegistered, match='5 matches, need 12'):
        robust_homography(pairs, (240, 320))


def test_chance_matches_do_not_agree():
    rng = np.random.default_rng(3)
    pairs = Pairs(rng.uniform(0, 300, (200, 2)), rng.uniform(0, 300, (200, 2)))
    with pytest.raises(NotRegistered, match='of 200 matches agree'):
        robust_homography(pairs, (240, 320))


@pytest.mark.parametrize(
    'h',
    [
        np.diag([-1.0, 1, 1]),
        np.diag([0.1, 0.1, 1]),
        np.diag([3.0, 3.0, 1]),
        np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1]]),
    ],
    ids=['mirror', 'shrink', 'zoom', 'fold'],
)
def test_implausible_outlines_are_refused(h):
    with pytest.raises(NotRegistered, match='folds the frame or scales its area'):
        check_outline(h, (240, 320))


def test_a_fit_that_explains_few_tracks_is_refused():
    check_agreement(np.zeros(30))
    with pytest.raises(NotRegistered, match='29 of 29 tracks agree, need 30'):
        check_agreement(np.zeros(29))
    with pytest.raises(NotRegistered, match='40 of 100 tracks agree, need 50'):
        check_agreement(np.repeat([0.0, 9.0], [40, 60]))
