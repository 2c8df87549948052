"""Changes are found in a registered pair, the same way for everyone."""

import numpy as np
import pytest

from rsmb_ros.evaluation.methods import Registration
from rsmb_ros.evaluation.rivals.decision import cleaned, fitted_light, otsu, tuned

SQUARE = np.s_[100:140, 150:190]


def still(reference):
    """Perfect registration of a still camera."""
    y, x = np.mgrid[: reference.shape[0], : reference.shape[1]]
    places = np.stack([x, y], axis=-1).astype(np.float32)
    return Registration(reference.astype(np.float32), np.ones(reference.shape, bool), places)


def with_square(reference, noise=3.0):
    """Live frame with a bright square, its truth."""
    grain = np.random.default_rng(2).normal(0, noise, reference.shape)
    live = (reference + grain).astype(np.float32)
    live[SQUARE] += 90
    truth = np.zeros(reference.shape, bool)
    truth[SQUARE] = True
    return live, truth


def overlap(found, truth):
    """Intersection over union of two masks."""
    return np.count_nonzero(found & truth) / np.count_nonzero(found | truth)


@pytest.mark.parametrize('decide', [otsu, tuned])
def test_a_square_is_found(decide, reference):
    live, truth = with_square(reference)
    found = decide(live, still(reference))
    assert found.dtype == bool
    assert overlap(found, truth) > 0.85  # smoothing moves the edge by a pixel


def test_other_light_is_no_change_once_tuned(reference):
    live, truth = with_square(reference)
    live = 0.6 * live + 10
    assert overlap(tuned(live, still(reference)), truth) > 0.85
    assert overlap(otsu(live, still(reference)), truth) < 0.5


def test_noise_is_no_change_once_tuned(reference):
    grain = np.random.default_rng(2).normal(0, 12, reference.shape).astype(np.float32)
    assert not tuned(reference + grain, still(reference)).any()


@pytest.mark.parametrize('decide', [otsu, tuned])
def test_nothing_changes_outside_the_reference(decide, reference):
    live, _ = with_square(reference)
    registration = still(reference)
    registration.inside[:, 140:200] = False
    assert not decide(live, registration)[:, 140:200].any()


@pytest.mark.parametrize('decide', [otsu, tuned])
def test_equal_flat_images_have_no_change(decide):
    flat = np.full((60, 80), 90, np.uint8)
    assert not decide(flat.astype(np.float32), still(flat)).any()


def test_light_is_fitted_beside_a_change(reference):
    live, _ = with_square(reference, noise=1.0)
    gain, bias = fitted_light(reference.ravel(), (0.8 * live + 10).ravel())
    assert gain == pytest.approx(0.8, abs=0.01)
    assert bias == pytest.approx(10, abs=1.0)  # grey levels


def test_a_flat_reference_tells_no_gain():
    assert fitted_light(np.full(50, 80.0), np.full(50, 95.0)) == (1.0, 15.0)


def test_specks_go_and_gaps_close():
    mask = np.zeros((240, 320), bool)
    mask[50:90, 60:80] = mask[50:90, 83:103] = True
    mask[200, 200] = mask[10:12, 10:12] = True
    found = cleaned(mask)
    assert found[55:85, 60:103].all()
    assert not found[:40].any()
    assert not found[150:].any()
