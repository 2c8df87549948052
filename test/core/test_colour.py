"""Colour as evidence: what has the brightness of its surroundings."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.colour import ColourEvidence, tint_off
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.workers import workers

SHAPE = (240, 320)
PLACE = np.s_[100:130, 140:180]
NOISE = 3.0  # grey levels


@pytest.fixture(scope='module')
def reference(texture_of):
    """Ground with soft colours."""
    grey = texture_of(*SHAPE, 3).astype(np.float32) * 0.5 + 60.0
    rng = np.random.default_rng(4)
    soft = [cv2.resize(rng.normal(0, 12, (6, 8)).astype(np.float32), SHAPE[::-1]) for _ in range(3)]
    return np.clip(grey[..., None] + np.stack(soft, axis=-1), 0, 255).astype(np.uint8)


def noisy(image, seed=5):
    noise = np.random.default_rng(seed).normal(0, NOISE, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def tinted(image, levels):
    """Another tint at `PLACE`, as bright as before."""
    changed = image.astype(np.float32)
    red, blue = levels, -levels * 0.299 / 0.114  # luma weights: they cancel
    changed[(*PLACE, 2)] += red
    changed[(*PLACE, 0)] += blue
    return np.clip(changed, 0, 255).astype(np.uint8)


def evidence_of(live, predicted, judged=None):
    everywhere = np.ones(SHAPE, bool) if judged is None else judged
    flat = np.ones(SHAPE, np.float32)
    place = np.zeros(SHAPE[0], np.float32)
    return ColourEvidence.of(live, predicted, everywhere, flat, place, workers(2))


def test_noise_is_not_evidence(reference):
    strength = evidence_of(noisy(reference), reference).strength
    assert strength.shape == SHAPE
    assert strength.dtype == np.float32
    assert np.percentile(strength, 99.9) < Config().change.threshold_low


def test_another_tint_of_the_same_brightness_is(reference):
    live = tinted(reference, 22.0)
    assert np.abs(luma(live) - luma(reference)).mean() < 0.5
    strength = evidence_of(noisy(live), reference).strength
    inside = np.zeros(SHAPE, bool)
    inside[PLACE] = True
    core = cv2.erode(inside.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert strength[core].min() > Config().change.threshold_high
    far = cv2.dilate(inside.astype(np.uint8), np.ones((25, 25), np.uint8)) == 0
    assert np.percentile(strength[far], 99.9) < Config().change.threshold_low


def test_what_is_not_judged_says_nothing(reference):
    judged = np.ones(SHAPE, bool)
    judged[PLACE] = False
    strength = evidence_of(tinted(reference, 30.0), reference, judged).strength
    assert strength[110:120, 150:170].max() == 0.0


def test_a_white_balance_is_not_evidence(reference):
    other = reference.astype(np.float32) + np.array([9.0, 0.0, -9.0])
    cast = np.clip(other, 0, 255).astype(np.uint8)
    strength = evidence_of(noisy(cast), reference).strength
    assert np.percentile(strength, 99.9) < Config().change.threshold_low


def test_nothing_judged_is_no_evidence(reference):
    found = evidence_of(reference, reference, np.zeros(SHAPE, bool))
    assert not found.strength.any()


def test_differences_of_tints_are_in_levels(reference):
    mask = np.ones(SHAPE, bool)
    assert tint_off(reference, reference, mask) == 0.0
    lighter = cv2.add(reference, (9.0, 9.0, 9.0, 0.0))
    assert tint_off(lighter, reference, mask) < 0.5, 'what is only lighter has the same tint'
    # C_b is 0.564 (B - Y)
    assert tint_off(tinted(reference, 10.0)[PLACE], reference[PLACE], mask[PLACE]) == pytest.approx(
        0.564 * 10.0 * 0.299 / 0.114, abs=1.5
    )
    assert tint_off(reference, reference, ~mask) == 0.0


def test_an_object_that_only_differs_in_colour_is_found(reference):
    live = noisy(tinted(reference, 22.0))
    changes = Detector(reference).detect(live).changes
    assert len(changes) == 1
    (found,) = changes
    assert abs(found.x - 140) < 6
    assert abs(found.y - 100) < 6
    assert abs(found.width - 40) < 9
    assert abs(found.height - 30) < 9
    grey = Detector(cv2.cvtColor(reference, cv2.COLOR_BGR2GRAY)).detect(
        cv2.cvtColor(live, cv2.COLOR_BGR2GRAY)
    )
    assert not grey.changes
