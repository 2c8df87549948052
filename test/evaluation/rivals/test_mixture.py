"""Grundmann et al.: a mixture of homographies over the rows."""

import numpy as np

from rsmb_ros.evaluation.rivals.features import HomographyRegistrar, Pairs
from rsmb_ros.evaluation.rivals.mixture import (
    MixtureRegistrar,
    fitted_blocks,
    in_pixels,
    normaliser,
    row_weights,
)
from rsmb_ros.evaluation.warping import mapped

SHAPE = (240, 320)
SCALES = (normaliser(SHAPE), normaliser(SHAPE))


def test_a_wobble_is_found_better_than_by_a_homography(
    reference, row_time, moved_rows, taken, place_error
):
    wobble = np.sin(6 * row_time), np.cos(6 * row_time)
    places = moved_rows(5 * wobble[0], 3 * wobble[1], 0.01 * wobble[0])
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    mixture = place_error(MixtureRegistrar().register(*pair, None), places)
    stiff = place_error(HomographyRegistrar('sift').register(*pair, None), places)
    assert mixture < min(0.2, stiff / 5)  # px


def test_one_homography_is_a_mixture_too(homography_pair, homography_places, place_error):
    found = MixtureRegistrar().register(*homography_pair, None)
    assert place_error(found, homography_places) < 0.1  # px


def tracks(h, wrong):
    """Tracks under a homography, the first `wrong` of which follow something else."""
    rng = np.random.default_rng(11)
    live = rng.uniform([0, 0], [319, 239], (400, 2))
    reference = mapped(h, *live.T)
    reference[:wrong] += rng.uniform(-40, 40, (wrong, 2))
    return Pairs(live, reference)


def row_error(pairs, start, h):
    """Largest error of the fitted rows against one homography, at three columns [px]."""
    weights = row_weights(np.arange(SHAPE[0]), SHAPE[0])
    blocks = fitted_blocks(pairs, start, SCALES, SHAPE[0])
    hs = in_pixels(np.tensordot(weights, blocks, axes=1), SCALES)
    x, y = np.array([20.0, 160, 300]), np.arange(SHAPE[0])[:, None]
    return np.abs(mapped(hs[:, None], x, y) - mapped(h, x, y)).max()


def test_exact_tracks_give_the_homography_in_every_row(homography):
    assert row_error(tracks(homography, 0), np.eye(3), homography) < 1e-6


def test_a_third_of_wrong_tracks_hardly_matters(homography):
    assert row_error(tracks(homography, 130), homography, homography) < 0.5  # px


def test_a_gap_without_tracks_is_bridged(homography):
    pairs = tracks(homography, 0)
    pairs = pairs[(pairs.live[:, 1] < 80) | (pairs.live[:, 1] > 170)]
    assert row_error(pairs, np.eye(3), homography) < 1e-5


def test_weights_sum_to_1_and_peak_at_the_nearest_block():
    weights = row_weights(np.arange(240), 240)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_array_equal(weights.argmax(axis=1), np.arange(240) // 24)


def test_the_normaliser_takes_the_frame_to_half_widths():
    x, y = mapped(normaliser((240, 320)), np.array([-0.5, 319.5]), np.array([-0.5, 239.5])).T
    np.testing.assert_allclose(x, [-1, 1])
    np.testing.assert_allclose(y, [-0.75, 0.75])
