"""What lies a little beside is told from what is new."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.core.misplaced import misplaced
from rsmb_ros.core.segmentation import Blob

SHAPE = (160, 200)
INSIDE = Blob(np.ones((30, 44), bool), 80, 60)
AT_A_CORNER = Blob(np.ones((24, 30), bool), 0, 0)


@pytest.fixture(scope='module')
def ground(texture_of):
    return cv2.GaussianBlur(texture_of(*SHAPE, 11).astype(np.float32), (0, 0), 1.0)


def frame(predicted, live):
    noisy = live + np.random.default_rng(3).normal(0, 2.0, live.shape)
    return SimpleNamespace(predicted=predicted, grey=noisy.astype(np.float32))


def moved(image, x, y):
    by = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    return cv2.warpAffine(
        image, by, image.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


@pytest.mark.parametrize('blob', [INSIDE, AT_A_CORNER])
@pytest.mark.parametrize('x, y', [(1.5, -0.5), (-2.3, 1.0), (0.0, 2.6)])
def test_ground_that_lies_beside_is_misplaced(ground, blob, x, y):
    assert misplaced(blob, frame(ground, moved(ground, x, y)))


@pytest.mark.parametrize('x, y', [(6.0, 0.0), (-4.5, 5.0)])
def test_ground_from_further_away_is_not(ground, x, y):
    assert not misplaced(INSIDE, frame(ground, moved(ground, x, y)))


@pytest.mark.parametrize('seed', range(8))
def test_another_texture_is_not(ground, texture_of, seed):
    other = cv2.GaussianBlur(texture_of(*SHAPE, 100 + seed).astype(np.float32), (0, 0), 1.0)
    assert not misplaced(INSIDE, frame(ground, other))


@pytest.mark.parametrize('light', [lambda v: 0.6 * v, lambda v: 0.8 * v + 30.0, lambda v: v + 25.0])
def test_a_shadow_is_in_its_place(ground, light):
    assert not misplaced(INSIDE, frame(ground, light(ground)))


def test_what_has_no_texture_is_not_misplaced(ground):
    even = np.full_like(ground, 120.0)
    assert not misplaced(INSIDE, frame(ground, even))
    assert not misplaced(INSIDE, frame(even, ground))
    assert not misplaced(INSIDE, SimpleNamespace(predicted=even, grey=even))
