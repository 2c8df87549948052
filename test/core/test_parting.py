"""Neighbours that changed together are two, one object is one."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.core import parting
from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.parting import parted
from rsmb_ros.core.segmentation import Blob, blobs

SHAPE = (240, 320)
CONFIG = ChangeConfig()
JUDGED = np.ones(SHAPE, bool)
LOW, HIGH = 1.5, 8.0  # sigma


def seen(shown, seed=4):
    """Evidence of a mask: high where something shows, noise elsewhere."""
    noise = np.random.default_rng(seed).uniform(0.5, 1.5, SHAPE)
    evidence = np.where(shown, HIGH, noise).astype(np.float32)
    return SimpleNamespace(sharp=evidence, strength=evidence)


def blob_of(mask, x=100, y=80):
    return Blob(mask, x, y)


def on_frame(blob, mask):
    shown = np.zeros(SHAPE, bool)
    shown[blob.box] = mask
    return shown


def boxes(parts):
    return [(part.x, part.y, *part.mask.shape[::-1]) for part in parts]


@pytest.mark.parametrize('gap', [3, 5, 9])
def test_two_cars_side_by_side_are_two(gap):
    """The gap is closed in the mask, the evidence shows it."""
    mask = np.ones((40, 2 * 20 + gap), bool)
    cars = mask.copy()
    cars[:, 20 : 20 + gap] = False
    blob = blob_of(mask)
    parts = parted(blob, seen(on_frame(blob, cars)), JUDGED, CONFIG)
    assert len(parts) == 2
    assert 38 <= blob.area - sum(part.area for part in parts) <= 44  # a line between them
    left, right = parts
    assert left.x + left.mask.shape[1] <= right.x + gap
    assert min(left.area, right.area) > 0.45 * blob.area


def two_vehicles(between, side=8.0):
    """Two vehicles, one further on, over a shadow that joins them; its evidence, and the blob."""
    mask = np.zeros((64, 90), bool)
    mask[:28, 30:] = mask[36:, :60] = mask[28:36, 34:56] = True
    found = seen(on_frame(blob_of(mask), mask))
    found.sharp[:] = np.where(found.sharp == HIGH, side, found.sharp)
    found.sharp[108:116] = np.where(found.sharp[108:116] == side, between, found.sharp[108:116])
    return blob_of(mask), SimpleNamespace(sharp=found.sharp, strength=found.sharp)


def test_weak_evidence_at_a_waist_joins_no_two_vehicles():
    blob, found = two_vehicles(between=3.5)
    upper, lower = parted(blob, found, JUDGED, CONFIG)
    assert upper.y == 80 and abs(upper.y + upper.mask.shape[0] - 112) < 4
    assert lower.y + lower.mask.shape[0] == 144 and abs(lower.y - 112) < 4
    drawn = np.zeros(SHAPE, np.uint8)
    for part in (upper, lower):
        drawn[part.box] |= part.mask
    assert cv2.connectedComponents(drawn, connectivity=8)[0] == 3  # with the background


@pytest.mark.parametrize(('between', 'side'), [(7.0, 8.0), (4.5, 5.5)])
def test_a_waist_alone_parts_nothing(between, side):
    blob, found = two_vehicles(between, side)
    assert boxes(parted(blob, found, JUDGED, CONFIG)) == [(100, 80, 90, 64)]


def test_a_roof_that_shows_weakly_in_the_middle_is_one():
    mask = np.ones((40, 80), bool)
    blob = blob_of(mask)
    found = seen(on_frame(blob, mask))
    found.strength[:, 136:144] = 3.0
    assert len(parted(blob, found, JUDGED, CONFIG)) == 1


def test_a_narrow_bridge_does_not_join_two():
    mask = np.zeros((30, 70), bool)
    mask[:, :30] = mask[:, 40:] = True
    mask[14:16, 30:40] = True
    parts = parted(blob_of(mask), seen(on_frame(blob_of(mask), mask)), JUDGED, CONFIG)
    assert len(parts) == 2


@pytest.mark.parametrize('bridge', [10, 18, 30])
def test_a_neck_of_a_third_is_part_of_an_object(bridge):
    mask = np.zeros((30, 70), bool)
    mask[:, :30] = mask[:, 40:] = True
    mask[15 - bridge // 2 : 15 + bridge // 2, 30:40] = True
    blob = blob_of(mask)
    assert boxes(parted(blob, seen(on_frame(blob, mask)), JUDGED, CONFIG)) == [(100, 80, 70, 30)]


def test_holes_and_specks_do_not_split_an_object():
    mask = np.ones((40, 80), bool)
    shown = np.random.default_rng(11).random(mask.shape) > 0.1
    shown[10:30, 30:50] = False  # a roof as grey as the road, framed by what is not
    blob = blob_of(mask)
    assert len(parted(blob, seen(on_frame(blob, shown)), JUDGED, CONFIG)) == 1


def test_the_unknown_cuts_nothing():
    mask = np.ones((40, 80), bool)
    mask[:, 38:42] = False
    mask[20, 38:42] = True
    blob = blob_of(mask)
    judged = JUDGED.copy()
    assert len(parted(blob, seen(on_frame(blob, mask)), judged, CONFIG)) == 2
    judged[blob.box] &= mask
    assert len(parted(blob, seen(on_frame(blob, mask)), judged, CONFIG)) == 1


def test_what_would_be_no_object_of_its_own_stays():
    mask = np.zeros((30, 60), bool)
    mask[:, :30] = mask[14:16, 30:40] = True
    mask[5:25, 40:] = True
    found = seen(on_frame(blob_of(mask), mask))
    assert len(parted(blob_of(mask), found, JUDGED, CONFIG)) == 2
    weak = SimpleNamespace(sharp=found.sharp, strength=found.strength.copy())
    weak.strength[:, 132:] = CONFIG.threshold_high - 1.0
    assert len(parted(blob_of(mask), weak, JUDGED, CONFIG)) == 1
    large = ChangeConfig(min_area=500 / (SHAPE[0] * SHAPE[1]))
    assert len(parted(blob_of(mask), found, JUDGED, large)) == 1


def touching_shapes(rng):
    """Some discs and boxes that touch, their gaps closed, cut by lines where nothing shows."""
    drawn = np.zeros((160, 160), np.uint8)
    for x, y, size, other in rng.integers((20, 20, 6, 6), (130, 130, 30, 30), (5, 4)).tolist():
        cv2.ellipse(drawn, (x, y), (size, other), 0, 0, 360, 1, -1)
        cv2.rectangle(drawn, (y, x), (y + size, x + other), 1, -1)
    shown = drawn.copy()
    for x, y, u, v in rng.integers(0, 160, (4, 4)).tolist():
        cv2.line(shown, (x, y), (u, v), 0, 2)
    return cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)), shown


def test_what_has_no_neck_is_whole_after_a_watershed_too(monkeypatch):
    whole = several = 0
    for seed in range(12):
        drawn, shown = touching_shapes(np.random.default_rng(seed))
        found = seen(np.pad(shown, ((40, 40), (80, 80))) > 0, seed)
        for blob in blobs(np.pad(drawn, ((40, 40), (80, 80)))):
            parts = parted(blob, found, JUDGED, CONFIG)
            with monkeypatch.context() as always:
                always.setattr(parting, '_has_neck', lambda depth: True)
                assert boxes(parts) == boxes(parted(blob, found, JUDGED, CONFIG))
            whole, several = whole + (len(parts) == 1), several + (len(parts) > 1)
    assert whole > 5 and several > 5
