"""Noise table, segmentation, layers and agreement on inputs whose answer is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core.agreement import agreement, sharpness
from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.evidence import NoiseTable, Texture, evidence
from rsmb_ros.core.segmentation import blobs, candidates, without_thin


def test_noise_table_learns_sigma_by_intensity():
    rng = np.random.default_rng(1)
    predicted = np.tile(np.linspace(20, 220, 320, dtype=np.float32), (240, 1))
    sigma = np.where(predicted < 120, 6.0, 2.0)
    residual = (rng.normal(0, 1, predicted.shape) * sigma).astype(np.float32)
    table = NoiseTable.learn(Texture.of(predicted), residual, np.ones(predicted.shape, bool))
    found = table(Texture.of(predicted))
    assert abs(np.median(found[:, 20:120]) - 6.0) < 1.0  # bins are smoothed
    assert abs(np.median(found[:, 200:300]) - 2.0) < 0.5


def test_noise_table_is_not_fooled_by_a_large_change():
    rng = np.random.default_rng(2)
    predicted = np.tile(np.linspace(40, 200, 320, dtype=np.float32), (240, 1))
    residual = rng.normal(0, 2.0, predicted.shape).astype(np.float32)
    residual[:72] += 80.0  # 30 % of the frame
    table = NoiseTable.learn(Texture.of(predicted), residual, np.ones(predicted.shape, bool))
    assert np.median(table(Texture.of(predicted))) < 4.0


def test_evidence_of_pure_noise_is_one_sigma():
    z = np.random.default_rng(3).normal(0, 1, (200, 300)).astype(np.float32)
    assert abs(np.median(evidence(z)) - 1.0) < 0.02
    assert evidence(np.zeros((50, 50), np.float32)).max() == 0.0


def test_outline_of_an_object_becomes_the_whole_object():
    strength = np.ones((480, 640), np.float32)
    strength[100:160, 200:300] = 6.0
    strength[106:154, 206:294] = 1.0  # a flat inside looks like the ground
    mask = candidates(strength, ChangeConfig())
    found = blobs(mask)
    assert len(found) == 1
    assert abs(found[0].area - 60 * 100) < 500


def test_weak_evidence_alone_is_no_object():
    strength = np.ones((480, 640), np.float32)
    strength[100:160, 200:300] = 3.0  # above the low, below the high threshold
    assert not candidates(strength, ChangeConfig()).any()


@pytest.mark.parametrize(('side', 'kept'), [(8, False), (12, True)])
def test_objects_below_the_minimum_area_are_dropped(side, kept):
    strength = np.ones((480, 640), np.float32)
    strength[100 : 100 + side, 200 : 200 + side] = 9.0
    assert candidates(strength, ChangeConfig()).any() == kept


def test_thin_leftovers_are_not_objects():
    mask = np.zeros((60, 80), np.uint8)
    mask[20:23, 10:70] = 1
    mask[40:50, 10:30] = 1
    assert np.count_nonzero(without_thin(mask)) == 200


def test_agreement_counts_blocks_not_pixels(texture_of):
    image = texture_of(240, 320, 4).astype(np.float32)
    other = texture_of(240, 320, 5).astype(np.float32)
    whole = np.ones(image.shape, bool)
    assert agreement(image, 1.3 * image + 10, whole).share == 1.0
    half = np.where(np.arange(240)[:, None] < 120, image, other)
    assert abs(agreement(image, half, whole).share - 0.5) < 0.12
    assert agreement(image, other, whole).share < 0.15
    assert agreement(np.full_like(image, 9), np.full_like(image, 9), whole).share is None


def test_a_smeared_prediction_is_told_from_a_right_one(texture_of):
    image = texture_of(240, 320, 7).astype(np.float32)
    judged = np.ones(image.shape, bool)
    assert abs(sharpness(image, image, judged) - 1.0) < 1e-6
    assert sharpness(cv2.blur(image, (21, 21)), image, judged) < 0.6


@pytest.mark.parametrize('noise', [4.0, 10.0])
def test_noise_makes_no_smeared_prediction_sharp(texture_of, noise):
    """Nor does it make a right one soft, when it is the live frame's."""
    image = texture_of(240, 320, 7).astype(np.float32)
    grain = np.random.default_rng(8).normal(0, noise, image.shape).astype(np.float32)
    judged = np.ones(image.shape, bool)
    smeared = cv2.blur(image, (21, 21))
    assert sharpness(smeared + grain, image, judged) < 0.6
    assert sharpness(image, image + grain, judged) > 0.85


def test_edges_of_a_new_object_do_not_make_the_ground_look_smeared(texture_of):
    """A truck on asphalt: only the live frame has such edges."""
    image = 100.0 + 0.15 * texture_of(240, 320, 7).astype(np.float32)
    live, judged = image.copy(), np.ones(image.shape, bool)
    truck = np.random.default_rng(9).uniform(20, 230, (20, 28)).astype(np.float32)
    live[64:144, 96:208] = truck.repeat(4, axis=0).repeat(4, axis=1)
    assert sharpness(image, live, judged) < 0.6
    found = agreement(image, live, judged)
    assert 0.6 < found.share < 0.95
    alike = found.within(judged)
    assert not alike[64:144, 96:208].any()
    assert abs(sharpness(image, live, alike) - 1.0) < 0.05
    assert sharpness(cv2.blur(image, (21, 21)), live, alike) < 0.6


def test_only_what_is_judged_counts_as_sharp(texture_of):
    image = texture_of(240, 320, 7).astype(np.float32)
    smeared = cv2.blur(image, (21, 21))
    smeared[:, :160] = image[:, :160]
    left = np.zeros(image.shape, bool)
    left[:, :150] = True
    assert sharpness(smeared, image, left) > 0.99
    assert sharpness(smeared, image, ~left & (np.arange(320) > 170)) < 0.6
