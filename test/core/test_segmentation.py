"""Outlines of objects from evidence that is as wide as its window."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core.change_finder import Seen
from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.evidence import MAX_Z2, evidence
from rsmb_ros.core.segmentation import (
    blobs,
    candidates,
    filled,
    hysteresis,
    outline_level,
    tightened,
    without_small,
)

CONFIG = ChangeConfig()
LEVEL = outline_level(CONFIG)
SHAPE = (480, 640)


def disc(radius, center=(300.0, 220.0)):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.hypot(x - center[0], y - center[1]) <= radius


def drawn(truth, strength, seed=3):
    """Mask and outline of an object whose residual is `strength` sigma all over, in noise."""
    z = np.random.default_rng(seed).normal(0, 1, SHAPE).astype(np.float32)
    z[truth] += strength * np.random.default_rng(seed + 1).choice([-1.0, 1.0], truth.sum())
    wide = candidates(evidence(z), CONFIG)
    seen = Seen(None, None, None, wide, np.minimum(z * z, np.float32(MAX_Z2)), LEVEL)
    return wide, tightened(wide, seen.sharp, LEVEL)


def radius_of(mask):
    return np.sqrt(np.count_nonzero(mask) / np.pi)


@pytest.mark.parametrize('radius', [12, 25, 60])
@pytest.mark.parametrize('strength', [8.0, 12.0, 20.0, 60.0])
def test_outline_of_a_disc_is_right_to_half_a_pixel(radius, strength):
    truth = disc(radius)
    wide, tight = drawn(truth, strength)
    true = radius_of(truth)
    assert radius_of(wide) - true > 1.5, 'the window of the evidence widens it'
    assert abs(radius_of(tight) - true) < 0.5
    assert not np.any(tight & ~wide)
    core = cv2.erode(truth.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert tight[core].all()


def test_a_weak_object_keeps_its_outline():
    """What shows over the larger window only is not cut to the specks that show over the small."""
    wide = disc(20).astype(np.uint8)
    sharp = np.where(disc(20), np.float32(2.5), np.float32(1.0))
    sharp[disc(4, (295.0, 215.0))] = 9.0
    np.testing.assert_array_equal(tightened(wide, sharp, LEVEL), wide)


def test_each_object_is_judged_alone():
    weak, strong = disc(20, (150.0, 200.0)), disc(20, (450.0, 200.0))
    inside = disc(16, (450.0, 200.0))
    sharp = np.ones(SHAPE, np.float32)
    sharp[weak] = 2.5
    sharp[inside] = 9.0
    tight = tightened((weak | strong).astype(np.uint8), sharp, LEVEL) > 0
    np.testing.assert_array_equal(tight, weak | inside)


@pytest.mark.parametrize('gap', [1, 3, 6])
def test_a_thin_gap_does_not_split_an_object(gap):
    mask = np.zeros(SHAPE, np.uint8)
    mask[200:260, 300:400] = 1
    sharp = np.where(mask > 0, np.float32(9.0), np.float32(1.0))
    sharp[:, 350 : 350 + gap] = 1.0
    found = blobs(tightened(mask, sharp, LEVEL))
    assert len(found) == 1
    assert found[0].area >= 0.98 * 6000


def test_a_wide_gap_does_split_it():
    mask = np.zeros(SHAPE, np.uint8)
    mask[200:260, 300:400] = 1
    sharp = np.where(mask > 0, np.float32(9.0), np.float32(1.0))
    sharp[:, 340:360] = 1.0
    assert len(blobs(tightened(mask, sharp, LEVEL))) == 2


def test_an_object_at_the_border_keeps_its_edge_there():
    mask = np.zeros(SHAPE, np.uint8)
    mask[:40, :50] = 1
    sharp = np.where(mask > 0, np.float32(9.0), np.float32(1.0))
    np.testing.assert_array_equal(tightened(mask, sharp, LEVEL), mask)


def test_regions_in_each_others_boxes_are_told_apart():
    """A dot in a ring and two hooks, beside one that is alone."""
    mask = np.zeros((60, 80), np.uint8)
    mask[5:30, 5:30], mask[8:27, 8:27], mask[15:18, 15:18] = 1, 0, 1
    mask[40:55, 5:7], mask[53:55, 5:20], mask[40:42, 9:22], mask[40:50, 20:22] = 1, 1, 1, 1
    alone = mask.copy()
    alone[:, 40:] = 0
    mask[20:30, 50:70] = 1
    found = blobs(mask)
    assert [blob.area for blob in found] == [25**2 - 19**2, 9, 20 * 10, 15 * 2 + 13 * 2, 26 + 16]
    assert all(np.all(mask[blob.box][blob.mask] == 1) for blob in found)
    assert len(blobs(alone)) == 4


@pytest.mark.parametrize('share', [0.02, 0.1, 0.3, 0.6])
def test_blobs_are_the_connected_regions_in_order(share):
    """Regions in holes of others, at the edges of the image, of one pixel."""
    rng = np.random.default_rng(round(100 * share))
    for size in rng.integers(1, 50, (20, 2)):
        mask = (rng.random(size) < share).astype(np.uint8)
        count, labels = cv2.connectedComponents(mask, connectivity=8)
        found = blobs(mask)
        assert len(found) == count - 1
        assert [blob.y for blob in found] == sorted(blob.y for blob in found)
        drawn_by = np.zeros(mask.shape, np.int32)
        for blob in found:
            (name,) = np.unique(labels[blob.box][blob.mask])
            drawn_by[blob.box][blob.mask] = name
            edges = (blob.mask[0], blob.mask[-1], blob.mask[:, 0], blob.mask[:, -1])
            assert all(edge.any() for edge in edges), 'the box is as small as it can be'
        np.testing.assert_array_equal(drawn_by, labels)


def test_outlines_are_closed_as_if_all_were_closed_at_once():
    rng = np.random.default_rng(8)
    noise = cv2.GaussianBlur(rng.normal(0, 1, SHAPE).astype(np.float32), (0, 0), 3.0)
    evidence = np.abs(noise) * (1.5 / noise.std())
    cv2.circle(evidence, (100, 120), 50, 6.0, 6)  # holds others
    cv2.circle(evidence, (0, 300), 40, 6.0, 6)
    grown = hysteresis(evidence, CONFIG)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (11, 11))
    wide = cv2.copyMakeBorder(grown, *[20] * 4, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, disc)[20:-20, 20:-20]
    opened = cv2.morphologyEx(filled(closed), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    expected = without_small(opened, CONFIG)
    assert len(blobs(expected)) > 2
    np.testing.assert_array_equal(candidates(evidence, CONFIG), expected)
