"""Which leftovers beside a static object are its rim, and which are things."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.depth_rims import depth_rims
from rsmb_ros.core.layers import Layer, Place
from rsmb_ros.core.segmentation import Blob

SHAPE = (480, 640)
ROOF = Layer(
    Blob(np.ones((80, 100), bool), 200, 150), np.ones((80, 100), bool), Place(0.9), share=0.9
)


def found(rows, cols, layers=(ROOF,), shape=SHAPE):
    mask = np.zeros(shape, np.uint8)
    mask[rows, cols] = 1
    rims = depth_rims(mask, layers)
    assert not np.any(rims & ~mask)
    return bool(rims.any()), bool(np.array_equal(rims, mask))


@pytest.mark.parametrize(
    ('rows', 'cols'),
    [
        (np.s_[150:230], np.s_[303:309]),  # beside the wall
        (np.s_[240:246], np.s_[210:260]),  # below it
        (np.s_[170:200], np.s_[240:246]),  # on the roof
        (np.s_[150:230], np.s_[335:341]),  # as long as a wall that is explained in part
    ],
)
def test_long_thin_pieces_beside_a_static_object_are_rims(rows, cols):
    assert found(rows, cols) == (True, True)


@pytest.mark.parametrize(
    ('rows', 'cols'),
    [
        (np.s_[150:230], np.s_[400:406]),  # far from it
        (np.s_[150:180], np.s_[330:336]),  # not so far, but short
        (np.s_[150:230], np.s_[303:315]),  # wide
        (np.s_[170:180], np.s_[303:311]),  # compact: a person, a box
    ],
)
def test_other_pieces_are_none(rows, cols):
    assert found(rows, cols) == (False, False)


def test_without_static_objects_nothing_is_a_rim():
    assert found(np.s_[150:230], np.s_[303:309], layers=()) == (False, False)


def test_sizes_grow_with_the_frame():
    twice = (960, 1280)
    big = Layer(
        Blob(np.ones((160, 200), bool), 400, 300), np.ones((160, 200), bool), Place(0.9), 0.9
    )
    assert found(np.s_[300:460], np.s_[610:621], (big,), twice) == (True, True)
    assert found(np.s_[300:460], np.s_[610:621], (big,)) == (False, False)


def test_a_rim_at_the_edge_of_the_frame_is_found():
    corner = Layer(Blob(np.ones((40, 40), bool), 600, 0), np.ones((40, 40), bool), Place(0.9), 0.9)
    assert found(np.s_[0:40], np.s_[590:595], (corner,)) == (True, True)
