"""The report's segmentation against the words it is described in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.entropy import CLOSE_PX, entropy_candidates, entropy_threshold
from rsmb_ros.core.segmentation import blobs

SHAPE = (256, 384)
CONFIG = ChangeConfig()
JUDGED = np.ones(SHAPE, bool)


def literal_threshold(counts):
    """Kapur, Sahoo, Wong 1985, Eq. for H_A + H_B, term by term."""
    total = sum(counts)
    best, most = 0, -math.inf
    for t in range(len(counts)):
        parts = []
        for part in (counts[: t + 1], counts[t + 1 :]):
            mass = sum(part)
            if mass == 0:
                break
            parts.append(-sum(n / mass * math.log(n / mass) for n in part if n))
        if total and len(parts) == 2 and sum(parts) > most + 1e-9:
            best, most = t, sum(parts)
    return best


@pytest.mark.parametrize('seed', range(8))
def test_threshold_is_that_of_the_literal_formula(seed):
    rng = np.random.default_rng(seed)
    levels = np.concatenate(
        [np.abs(rng.normal(0, 4, 5000)), np.abs(rng.normal(rng.uniform(30, 90), 15, 60 * seed))]
    )
    counts = np.bincount(np.minimum(levels, 255).astype(int), minlength=256)
    assert entropy_threshold(counts) == literal_threshold(counts.tolist())


def test_threshold_of_what_cannot_be_split_is_zero():
    assert entropy_threshold(np.zeros(256, int)) == 0
    assert entropy_threshold(np.bincount([7] * 100, minlength=256)) == 0


def scene(gap=0, specks=0):
    """An outline of 60 x 80 px, 4 px strong, with gaps of so many pixels, in noise."""
    rng = np.random.default_rng(1985)
    residual = rng.normal(0, 2, SHAPE).astype(np.float32)
    outline = np.zeros(SHAPE, bool)
    outline[100:160, 150:230] = True
    outline[104:156, 154:226] = False
    outline[:, 190 : 190 + gap] = False
    residual[outline] = 60.0 + rng.normal(0, 15, np.count_nonzero(outline))
    for _ in range(specks):
        residual[rng.integers(SHAPE[0] // 4), rng.integers(SHAPE[1])] = -120.0
    return residual


@pytest.mark.parametrize('gap', [0, 4, 8])
def test_an_outline_becomes_the_whole_object(gap):
    (found,) = blobs(entropy_candidates(scene(gap), JUDGED, CONFIG))
    assert abs(found.area - 60 * 80) < 0.03 * 60 * 80


def test_a_wide_gap_leaves_it_open():
    mask = entropy_candidates(scene(int(2 * CLOSE_PX) + 4), JUDGED, CONFIG)
    assert np.count_nonzero(mask) < 0.5 * 60 * 80


def test_specks_and_the_unknown_are_dropped():
    mask = entropy_candidates(scene(specks=40), JUDGED, CONFIG)
    assert not mask[:64].any()
    nothing = entropy_candidates(scene(), np.zeros(SHAPE, bool), CONFIG)
    assert not nothing.any()


def test_an_object_at_the_border_is_not_glued_to_it():
    residual = np.random.default_rng(2).normal(0, 2, SHAPE).astype(np.float32)
    residual[4:40, 60:100] = 70.0 + 10 * np.random.default_rng(3).normal(0, 1, (36, 40))
    (found,) = blobs(entropy_candidates(residual, JUDGED, CONFIG))
    assert (found.y, found.mask.shape) == (4, (36, 40))
