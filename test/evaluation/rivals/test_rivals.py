"""Every rival is a method: it finds a square, bears bad images and repeats itself."""

import numpy as np
import pytest

from rsmb_ros.evaluation.rivals import RIVALS

NAMES = ['orb', 'sift', 'ecc', 'orb+dis', 'mixture', 'liang', 'ringaby', 'ringaby-planar']
DARK_SQUARE = np.s_[120:160, 150:190]


@pytest.fixture(scope='module')
def shifted_pair(reference, row_time, moved_rows, taken):
    """Reference and a live frame that slides along, with a striped square, and its truth."""
    live = taken(reference, moved_rows(4 + 2 * row_time, -3 - 2 * row_time))
    live[DARK_SQUARE] = np.where(np.arange(40) // 4 % 2, 10, 30)
    truth = np.zeros(live.shape, bool)
    truth[DARK_SQUARE] = True
    return reference, live, truth


def test_every_registrar_has_a_default_and_a_tuned_decision():
    assert list(RIVALS) == [name for n in NAMES for name in (n, f'{n}-tuned')]
    for name, rival in RIVALS.items():
        assert rival.name == name
        assert rival.source
        assert '\n' not in rival.source
    for name in NAMES:
        assert RIVALS[name].registrar is RIVALS[f'{name}-tuned'].registrar


@pytest.mark.parametrize('name', NAMES)
def test_a_square_is_found(name, shifted_pair):
    reference, live, truth = shifted_pair
    found = RIVALS[f'{name}-tuned'](reference, live, None)
    assert found.registered, found.reason
    overlap = np.count_nonzero(found.change & truth) / np.count_nonzero(found.change | truth)
    assert overlap >= 0.5
    assert found.seconds > 0
    assert found.reason == ''


def noise(seed):
    """Nothing but noise."""
    return np.random.default_rng(seed).integers(0, 256, (240, 320)).astype(np.uint8)


BLANK = np.full((240, 320), 128, np.uint8)
BAD = {
    'blank': (BLANK, BLANK),
    'noise': (noise(1), noise(2)),
    'tiny': (noise(1), noise(1)[:1, :1]),
}


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('pair', BAD)
def test_bad_images_are_not_registered_for_a_reason(name, pair):
    reference, live = BAD[pair]
    found = RIVALS[name](reference, live, None)
    assert not found.registered
    assert found.reason
    assert found.registration is None
    assert found.change.shape == found.valid.shape == live.shape
    assert not found.change.any()
    assert not found.valid.any()


@pytest.mark.parametrize('name', NAMES)
def test_other_places_are_not_registered(name, reference, texture_of):
    found = RIVALS[name](reference, texture_of(240, 320, 2), None)
    assert not found.registered
    assert found.reason


@pytest.mark.parametrize('name', NAMES)
def test_a_live_frame_may_be_smaller(name, reference):
    live = reference[30:210, 40:280]
    found = RIVALS[name](reference, live, None)
    assert found.registered, found.reason
    assert found.change.shape == live.shape
    y, x = np.mgrid[30:210, 40:280]
    error = np.linalg.norm(found.registration.places - np.stack([x, y], axis=-1), axis=2)
    assert np.median(error) < 0.5  # px; ORB knows places on coarse pyramid levels only so well


@pytest.mark.parametrize('name', NAMES)
def test_two_runs_are_equal_to_the_bit(name, shifted_pair):
    reference, live, _ = shifted_pair
    first, second = (RIVALS[name](reference, live, None) for _ in range(2))
    np.testing.assert_array_equal(first.registration.places, second.registration.places)
    np.testing.assert_array_equal(first.change, second.change)


@pytest.mark.parametrize('name', ['orb', 'ecc'])
def test_colour_is_read_as_its_luma(name, shifted_pair):
    reference, live, _ = shifted_pair
    grey = RIVALS[name](reference, live, None)
    bgr = RIVALS[name](np.dstack([reference] * 3), np.dstack([live] * 3), None)
    # px; luma of equal channels is off by float32 rounding
    np.testing.assert_allclose(bgr.registration.places, grey.registration.places, atol=1e-2)


def test_images_are_left_as_they_are(shifted_pair):
    reference, live, _ = shifted_pair
    copies = reference.copy(), live.copy()
    for name in NAMES:
        RIVALS[name](reference, live, None)
    np.testing.assert_array_equal(reference, copies[0])
    np.testing.assert_array_equal(live, copies[1])


def test_twins_can_share_a_registration(shifted_pair):
    reference, live, _ = shifted_pair
    attempt = RIVALS['orb'].register(reference, live, None)
    shared = RIVALS['orb-tuned'].judge(live, attempt)
    alone = RIVALS['orb-tuned'](reference, live, None)
    np.testing.assert_array_equal(shared.change, alone.change)
    assert shared.seconds >= attempt.seconds
