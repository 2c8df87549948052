"""A depth map goes with the reference of its stamp and size, in any order."""

import numpy as np
import pytest

from rsmb_ros.ros.pairing import Pairing

IMAGE = np.zeros((4, 6), np.uint8)
OTHER = np.ones((4, 6), np.uint8)
DEPTH = np.full((4, 6), 1.0, np.float32)
HOLED = np.where(np.eye(4, 6) > 0, np.nan, DEPTH).astype(np.float32)


@pytest.fixture
def pairing():
    return Pairing()


def test_image_alone_is_used_at_once(pairing):
    pair = pairing.image(IMAGE, 1)
    assert pair.image is IMAGE
    assert pair.depth is None


def test_depth_before_or_after_its_image(pairing):
    assert pairing.depth(DEPTH, 7) is None
    assert pairing.waiting() == 'there is no reference yet'
    assert pairing.image(IMAGE, 7).depth is DEPTH
    assert pairing.waiting() == ''
    later = Pairing()
    later.image(IMAGE, 7)
    assert later.depth(DEPTH, 7).depth is DEPTH


def test_what_is_repeated_changes_nothing(pairing):
    pairing.image(IMAGE, 1)
    assert pairing.depth(HOLED, 1) is not None
    assert pairing.depth(HOLED.copy(), 1) is None  # NaN is equal to NaN
    assert pairing.image(IMAGE.copy(), 1) is None
    assert pairing.image(IMAGE.copy(), 2) is None, 'repeated with a new stamp: still that one'
    assert pairing.depth(HOLED.copy(), 2) is None


def test_new_depth_of_the_same_image_takes_over(pairing):
    pairing.image(IMAGE, 1)
    pairing.depth(DEPTH, 1)
    assert pairing.depth(HOLED, 1).depth is HOLED


def test_new_image_does_not_inherit_the_depth_of_the_last(pairing):
    pairing.image(IMAGE, 1)
    pairing.depth(DEPTH, 1)
    assert pairing.image(OTHER, 2).depth is None
    assert pairing.waiting() == ('its stamp is 1 ns, that of the reference 2 ns: must be equal')
    assert pairing.depth(HOLED, 2).depth is HOLED


def test_depth_of_another_size_waits_and_says_why(pairing):
    pairing.image(IMAGE, 1)
    assert pairing.depth(DEPTH[:3], 1) is None
    assert pairing.waiting() == 'it is 3x6 px, the reference 4x6 px: must be equal'


def test_colour_images_have_depth_too(pairing):
    pairing.image(np.zeros((4, 6, 3), np.uint8), 1)
    assert pairing.depth(DEPTH, 1).depth is DEPTH
