"""Places are where they are said to be, and inside means inside."""

import cv2
import numpy as np
import pytest

from rsmb_ros.evaluation.methods import NotRegistered
from rsmb_ros.evaluation.warping import (
    mapped,
    places_of_homography,
    places_of_row_homographies,
    registration_at,
)


def test_identity_returns_the_reference(reference):
    image = reference.astype(np.float32)
    found = registration_at(places_of_homography(np.eye(3), image.shape), image)
    np.testing.assert_array_equal(found.registered, image)
    assert found.inside.all()
    assert found.places.dtype == np.float32


def test_inside_ends_exactly_at_the_last_pixel():
    image = np.arange(20, dtype=np.float32).reshape(4, 5)
    places = np.array([[[0, 0], [4, 3], [4.001, 3], [4, 3.001], [-0.001, 0], [2, -0.001]]])
    found = registration_at(places, image)
    assert found.inside.tolist() == [[True, True, False, False, False, False]]


def test_a_smaller_frame_is_sampled_at_its_places():
    image = np.arange(48, dtype=np.float32).reshape(6, 8)
    shift = np.array([[1, 0, 3], [0, 1, 2], [0, 0, 1.0]])
    found = registration_at(places_of_homography(shift, (2, 4)), image)
    np.testing.assert_array_equal(found.registered, image[2:4, 3:7])


def test_places_agree_with_opencv(homography):
    shape = (7, 9)
    y, x = np.mgrid[:7, :9]
    points = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    expected = cv2.perspectiveTransform(points, homography).reshape(7, 9, 2)
    found = places_of_homography(homography, shape)
    np.testing.assert_allclose(found, expected, atol=1e-5)  # float32


def test_each_row_has_its_own_homography(homography):
    hs = np.stack([np.eye(3), homography, 2 * homography])
    found = places_of_row_homographies(hs, (3, 5))
    for row, h in enumerate((np.eye(3), homography, homography)):
        np.testing.assert_array_equal(found[row], places_of_homography(h, (3, 5))[row])


def test_what_is_behind_the_camera_is_nowhere():
    tilted = np.array([[1, 0, 0], [0, 1, 0], [-0.1, 0, 1]])
    assert np.abs(mapped(tilted, np.array([20.0]), np.array([0.0]))).min() >= 1e6


def test_bad_numbers_are_outside():
    places = np.zeros((2, 2, 2))
    places[0, 0], places[0, 1] = np.nan, np.inf
    found = registration_at(places, np.ones((3, 3), np.float32))
    assert found.inside.tolist() == [[False, False], [True, True]]
    assert np.isfinite(found.registered).all()


def test_a_frame_beside_the_reference_is_not_registered():
    beside = np.array([[1, 0, 97], [0, 1, 0], [0, 0, 1.0]])
    with pytest.raises(NotRegistered, match='2% of the frame'):
        registration_at(places_of_homography(beside, (80, 100)), np.ones((80, 99), np.float32))
