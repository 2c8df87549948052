"""Candidates with their truth, and the score that is fitted to them."""

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core import Config
from rsmb_ros.core.regions import WEIGHTS, traits_of
from rsmb_ros.core.segmentation import Blob
from rsmb_ros.evaluation.score_fit import auc, fitted, reliability, report, scores
from rsmb_ros.evaluation.score_samples import Sample, faded, samples_of
from rsmb_ros.evaluation.suites import SUITES, Wish

TRUE = np.array([-4.0, 3.0, -2.0])


@pytest.fixture(scope='module')
def samples():
    """As many right as wrong ones, drawn by `TRUE`."""
    rng = np.random.default_rng(8)
    traits = np.stack([rng.uniform(0.0, 3.0, 6000), rng.uniform(0.0, 1.0, 6000)], axis=1)
    right = rng.uniform(size=6000) < 1 / (1 + np.exp(-TRUE[0] - traits @ TRUE[1:]))
    least = min(right.sum(), (~right).sum())
    kept = np.concatenate([np.flatnonzero(right)[:least], np.flatnonzero(~right)[:least]])
    return [Sample('made/0', traits[n], bool(right[n])) for n in kept]


def test_weights_that_samples_were_drawn_by_are_found(samples):
    found = fitted(samples)
    np.testing.assert_allclose(found[1:], TRUE[1:], atol=0.3)  # of 5000 samples


def test_how_many_right_ones_there_are_moves_nothing(samples):
    fewer = [one for n, one in enumerate(samples) if one.right or n % 4 == 0]
    np.testing.assert_allclose(fitted(fewer), fitted(samples), atol=0.4)


def test_scores_are_what_they_claim(samples):
    weights = fitted(samples[::2])
    table = reliability(samples[1::2], weights)
    assert sum(row.count for row in table) == len(samples) // 2
    assert len(table) == 8
    for row in table:
        assert row.low <= row.score <= row.high
        assert row.right == pytest.approx(row.score, abs=0.1)  # of 200 samples and more
    assert 0.8 < auc(samples, weights) < 0.95
    assert auc(samples, -weights) == pytest.approx(1 - auc(samples, weights))


def test_report_names_every_range(samples):
    text = report('held out', samples, fitted(samples)).splitlines()
    assert text[0].startswith(
        f'held out: {len(samples)} candidates, {len(samples) // 2} wrong, AUC'
    )
    assert len(text) == 9
    assert 'AUC' not in report('none', [one for one in samples if one.right], TRUE)


@pytest.fixture(scope='module')
def case():
    """Return a flat case with changes."""
    return next(SUITES['quick'].cases(Wish(first=1)))


def test_changes_of_a_case_are_right_candidates(case):
    found = list(samples_of(case, Config()))
    assert sum(one.right for one in found) >= case.objects.max()
    assert {one.case for one in found} == {case.name}
    weak = scores(found, np.array(WEIGHTS))
    assert weak[[one.right for one in found]].max() > 0.8
    assert all(one.traits.shape == (len(WEIGHTS) - 1,) for one in found)


def test_fading_leaves_what_is_unchanged(case):
    pale = faded(case, np.random.default_rng(1))
    there = case.label != 0
    np.testing.assert_array_equal(pale.live[~there], case.live[~there])

    def off(one):
        return np.abs(one.live.astype(float) - case.motion.clean)[case.label == 255].mean()

    assert off(pale) < 0.8 * off(case)


def test_case_without_a_clean_frame_cannot_fade(case):
    with pytest.raises(ValueError, match='no clean frame'):
        faded(replace(case, motion=None), np.random.default_rng(1))


def test_traits_are_peak_and_unknown_rim():
    strength = np.ones((40, 40), np.float32)
    strength[20, 20] = np.e**2
    judged = np.ones((40, 40), bool)
    blob = Blob(np.ones((6, 6), bool), 18, 18)
    np.testing.assert_allclose(traits_of(blob, strength, judged), [2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(traits_of(blob, strength, ~judged), [2.0, 1.0], atol=1e-6)
