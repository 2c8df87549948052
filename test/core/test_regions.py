"""What a change is called, and how sure that is."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.regions import (
    RIM_PX,
    SHADOW_SHARE,
    change_region,
    change_score,
    in_shade,
)
from rsmb_ros.core.segmentation import Blob, without_weak

SHAPE = (120, 160)
BLOB = Blob(np.ones((12, 20), bool), 60, 50)
JUDGED = np.ones(SHAPE, bool)


def evidence(peak):
    strength = np.full(SHAPE, 2.5, np.float32)
    strength[55, 70] = peak
    return strength


def test_score_grows_with_the_evidence():
    scores = [
        change_score(BLOB, evidence(peak), JUDGED) for peak in (3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    ]
    assert scores == sorted(scores)
    assert scores[0] < 0.05
    assert 0.2 < scores[2] < 0.5  # at the default threshold: to be looked at
    assert scores[-1] > 0.8


def test_score_has_a_value_without_any_evidence():
    assert 0.0 <= change_score(BLOB, np.zeros(SHAPE, np.float32), JUDGED) < 1e-3


def test_only_what_is_unknown_next_to_a_change_lowers_its_score():
    free = change_score(BLOB, evidence(8.0), JUDGED)
    scores = []
    for columns in (80, 82, 84):
        judged = JUDGED.copy()
        judged[:, columns:] = False
        scores.append(change_score(BLOB, evidence(8.0), judged))
    assert free > scores[2] > scores[1] > scores[0]
    far = JUDGED.copy()
    far[:, 80 + RIM_PX :] = False
    far[BLOB.box] = False  # holes inside are no rim
    assert change_score(BLOB, evidence(8.0), far) == free


def test_a_change_that_fills_the_frame_has_no_rim():
    whole = Blob(np.ones(SHAPE, bool), 0, 0)
    assert change_score(whole, evidence(8.0), JUDGED) == change_score(BLOB, evidence(8.0), JUDGED)


def test_a_change_of_light_is_less_sure():
    plain = change_region(BLOB, evidence(9.0), JUDGED)
    shade = in_shade(plain)
    assert (plain.kind, plain.shadow_like) == ('change', False)
    assert (shade.kind, shade.shadow_like) == ('change', True)
    assert shade.score == pytest.approx(SHADOW_SHARE * plain.score)
    assert (plain.x, plain.y, plain.width, plain.height, plain.area) == (60, 50, 20, 12, 240)


def test_what_nowhere_reaches_the_threshold_is_dropped():
    mask = np.zeros(SHAPE, np.uint8)
    mask[10:20, 10:20] = mask[50:62, 60:80] = 1
    strength = evidence(ChangeConfig().threshold_high)
    strength[30, 30] = 9.0  # not in a region
    kept = without_weak(mask, strength, ChangeConfig())
    assert not kept[:40].any()
    np.testing.assert_array_equal(kept[40:], mask[40:])
