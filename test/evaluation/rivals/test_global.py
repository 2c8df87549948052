"""ECC and flow on a frame under one homography, and the start they share."""

import numpy as np
import pytest

from rsmb_ros.evaluation.rivals.ecc import EccRegistrar
from rsmb_ros.evaluation.rivals.features import HomographyRegistrar
from rsmb_ros.evaluation.rivals.flow import FlowRegistrar, composed
from rsmb_ros.evaluation.rivals.offset import phase_offset


def test_phase_correlation_leads_from_live_to_reference(reference):
    image = reference.astype(np.float32)
    copy = image.copy()
    offset = phase_offset(image, image[20:220, 30:310])
    np.testing.assert_allclose(offset, [30, 20], atol=0.5)  # px
    np.testing.assert_array_equal(image, copy)


def test_phase_correlation_of_flat_images_says_nothing():
    flat = np.full((40, 50), 9, np.float32)
    np.testing.assert_array_equal(phase_offset(flat, flat), [0, 0])


def test_ecc_finds_a_homography(homography_pair, homography_places, place_error):
    reference, live = (image.copy() for image in homography_pair)
    found = EccRegistrar().register(reference, live, None)
    assert place_error(found, homography_places) < 0.05  # px, all pixels count
    np.testing.assert_array_equal(reference, homography_pair[0])  # OpenCV 5 overwrites inputs
    np.testing.assert_array_equal(live, homography_pair[1])


def test_ecc_starts_from_a_large_offset(reference, moved_rows, taken, place_error):
    places = moved_rows(np.full(240, 45.0), np.full(240, -30.0))
    live = taken(reference, places).astype(np.float32)
    found = EccRegistrar().register(reference.astype(np.float32), live, None)
    assert place_error(found, places) < 0.05  # px


def test_flow_finds_a_homography(homography_pair, homography_places, place_error):
    found = FlowRegistrar().register(*homography_pair, None)
    assert place_error(found, homography_places) < 0.1  # px


def test_flow_bends_where_a_homography_cannot(reference, row_time, moved_rows, taken, place_error):
    places = moved_rows(5 * np.sin(6 * row_time), 3 * np.cos(5 * row_time))
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    stiff = place_error(HomographyRegistrar('orb').register(*pair, None), places)
    assert place_error(FlowRegistrar().register(*pair, None), places) < min(0.3, stiff / 3)


def test_flow_comes_before_the_homography():
    h = np.array([[2.0, 0, 1], [0, 2, 0], [0, 0, 1]])
    flow = np.full((3, 4, 2), 0.5, np.float32)
    assert composed(h, flow)[1, 2] == pytest.approx([2 * 2.5 + 1, 2 * 1.5])
