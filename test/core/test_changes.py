"""From a settled frame to the changes that are reported."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from rsmb_ros.core.changes import changes_of, mask_of
from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.workers import workers

SHAPE = (240, 320)
CONFIG = ChangeConfig()
TWO = workers(2)


def finding(mask, strength, judged=None):
    """A settled frame whose evidence is as sharp as its window is wide."""
    judged = np.ones(SHAPE, bool) if judged is None else judged
    seen = SimpleNamespace(mask=mask, strength=strength, sharp=strength, outline=4.0)
    black = np.zeros(SHAPE, np.float32)  # no ground to show through
    frame = SimpleNamespace(judged=judged, grey=black, predicted=black)
    return SimpleNamespace(frame=frame, seen=seen, layers=())


def test_changes_make_up_the_mask():
    mask = np.zeros(SHAPE, np.uint8)
    mask[40:70, 50:90] = mask[150:180, 200:240] = 1
    strength = np.where(mask > 0, np.float32(8.0), np.float32(1.0))
    changes = changes_of(finding(mask, strength), CONFIG, TWO)
    assert [(one.region.x, one.region.y, one.region.area) for one in changes] == [
        (50, 40, 1200),
        (200, 150, 1200),
    ]
    np.testing.assert_array_equal(mask_of(changes, SHAPE), mask)


def test_what_is_left_of_a_change_must_stand_by_itself():
    """Its peak lies where something became unknown: the rest is no change of its own."""
    mask = np.zeros(SHAPE, np.uint8)
    mask[40:70, 50:120] = 1
    strength = np.where(mask > 0, np.float32(4.5), np.float32(1.0))
    strength[40:70, 50:80] = 9.0
    whole = changes_of(finding(mask, strength), CONFIG, TWO)
    assert [one.region.area for one in whole] == [2100]
    judged = np.ones(SHAPE, bool)
    judged[:, :85] = False
    assert changes_of(finding(mask, strength, judged), CONFIG, TWO) == []


def test_an_unlikely_change_is_not_reported():
    mask = np.zeros(SHAPE, np.uint8)
    mask[40:70, 50:90] = mask[150:180, 200:240] = 1
    strength = np.where(mask > 0, np.float32(8.0), np.float32(1.0))
    strength[150:180, 200:240] = 5.2
    every = changes_of(finding(mask, strength), replace(CONFIG, min_score=0.0), TWO)
    likely, unlikely = (one.region.score for one in every)
    assert unlikely < CONFIG.min_score < likely
    assert [one.region.x for one in changes_of(finding(mask, strength), CONFIG, TWO)] == [50]
