"""Rows that show another place are told from rows that hold large changes."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.lost_rows import row_agreement, row_doubts, unlike_rows

SHAPE = (240, 320)
BAND = 16  # px, as high as a block of such a frame is wide


@pytest.fixture(scope='module')
def images(texture_of):
    ground, elsewhere = (texture_of(*SHAPE, seed).astype(np.float32) for seed in (4, 44))
    rng = np.random.default_rng(8)
    return ground, elsewhere, rng.normal(0, 2.0, SHAPE).astype(np.float32)


def unlike(predicted, live, complete=None):
    known = np.ones(SHAPE, bool) if complete is None else complete
    return unlike_rows(row_agreement(predicted, live, known), len(live))


@pytest.mark.parametrize('first, last', [(0, 96), (80, 176), (144, 240)])
def test_rows_that_show_another_place_are_unlike(images, first, last):
    ground, elsewhere, noise = images
    live = ground + noise
    live[first:last] = elsewhere[first:last]
    rows = unlike(ground, live)
    assert rows[first:last].mean() > 0.9
    assert rows[: max(0, first - BAND)].sum() == rows[last + BAND :].sum() == 0


def test_a_frame_in_its_place_has_none(images):
    ground, _, noise = images
    assert not unlike(ground, ground + noise).any()


def test_a_change_over_most_of_the_width_leaves_ground_that_agrees(images):
    ground, elsewhere, noise = images
    live = ground + noise
    live[60:180, 20:220] = elsewhere[60:180, 20:220]
    assert not unlike(ground, live).any()


def test_few_rows_alone_are_a_change(images):
    ground, elsewhere, noise = images
    live = ground + noise
    live[100:150] = elsewhere[100:150]
    assert not unlike(ground, live).any()


def test_what_the_reference_does_not_show_is_not_asked(images):
    ground, elsewhere, noise = images
    complete = np.ones(SHAPE, bool)
    complete[:120] = False
    live = ground + noise
    live[:120] = elsewhere[:120]
    assert not unlike(ground, live, complete).any()


def test_rows_next_to_those_that_are_unlike_go_with_them_up_to_where_most_agrees(images):
    ground, elsewhere, noise = images
    live = ground + noise
    live[:96] = elsewhere[:96]
    live[96:128, 90:] = elsewhere[96:128, 90:]  # a quarter agrees: on its way out
    live[160:192, 90:] = elsewhere[160:192, 90:]  # a change
    rows = unlike(ground, live)
    assert rows[: 128 + BAND].all()
    assert not rows[128 + BAND :].any()


def test_unlike_rows_end_at_the_next_one_that_is_right_on_both_sides(images):
    ground, elsewhere, noise = images
    live = ground + noise
    live[80:160] = elsewhere[80:160]
    for rows in (np.s_[64:80], np.s_[160:192]):
        live[rows, 90:] = elsewhere[rows, 90:]
    rows = np.flatnonzero(unlike(ground, live))
    np.testing.assert_array_equal(rows, np.arange(64 - BAND, 192 + BAND))


def doubts(predicted, live, known=None):
    known = np.ones(predicted.shape, bool) if known is None else known
    return row_doubts(row_agreement(predicted, live, known), len(live))


def test_rows_of_a_frame_in_its_place_are_not_doubted(images):
    ground, _, noise = images
    np.testing.assert_array_equal(doubts(ground, ground + noise), 1.0)


def test_rows_in_which_noise_is_all_there_is_are_doubted(images):
    ground, _, noise = images
    ground = ground.copy()
    ground[80:160] = 0.02 * ground[80:160]
    other = np.random.default_rng(9).normal(0, 2.0, SHAPE)  # that of the reference
    found = doubts((ground + other).astype(np.float32), ground + noise)
    assert found[80:160].min() > 4.0
    np.testing.assert_array_equal(found[:80], 1.0)
    np.testing.assert_array_equal(found[160:], 1.0)


def test_a_change_is_no_doubt(images):
    ground, elsewhere, noise = images
    live, known = ground + noise, np.ones(SHAPE, bool)
    live[64:160, 40:], known[64:160, 40:] = elsewhere[64:160, 40:], False
    assert doubts(ground, live)[64:160].min() > 1.5
    np.testing.assert_array_equal(doubts(ground, live, known), 1.0)


def test_nothing_is_said_of_rows_without_a_reference(images):
    ground, elsewhere, _ = images
    known = np.ones(SHAPE, bool)
    known[:32] = False
    live = ground.copy()
    live[:32] = elsewhere[:32]
    np.testing.assert_array_equal(doubts(ground, live, known), 1.0)


def test_rows_below_the_last_band_are_like_it(texture_of):
    ground, elsewhere = (texture_of(250, 320, seed).astype(np.float32) for seed in (4, 44))
    live = ground.copy()
    live[224:] = elsewhere[224:]
    found = doubts(ground, live)
    assert found[224:].min() > 1.5
    assert len(found) == 250


def test_a_frame_lower_than_a_block_is_not_doubted(texture_of):
    ground = texture_of(32, 2000, 4).astype(np.float32)
    np.testing.assert_array_equal(doubts(ground, ground[:, ::-1].copy()), np.ones(32))
