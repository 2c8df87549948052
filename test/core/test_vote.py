"""Votes for where an image lies in a reference."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.coarse import ALONE, SURE, CoarseSearch
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.vote import GlobalVote

SHAPE = (90, 120)


def cut(scene, place, shape=SHAPE):
    """Return the part of a scene whose corner is `place` x, y."""
    x, y = place
    return np.ascontiguousarray(scene[y : y + shape[0], x : x + shape[1]])


@pytest.mark.parametrize('place', [(0, 0), (11, -7), (-20, 13)])
@pytest.mark.parametrize('wobble', [0, 1, 3])
def test_the_middle_of_what_is_as_good_is_elected(texture_of, executor, place, wobble):
    scene = texture_of(170, 200, 7).astype(np.float32)
    reference = cut(scene, (40, 40))
    vote = GlobalVote(reference, 0.3, wobble, executor).on(
        cut(scene, (40 + place[0], 40 + place[1]))
    )
    np.testing.assert_array_equal(vote.corner, place)
    assert vote.mean > 0.99
    assert vote.rival < ALONE


def test_a_place_in_a_mosaic_is_found(texture_of, executor):
    mosaic = texture_of(200, 300, 8).astype(np.float32)
    vote = GlobalVote(mosaic, 0.3, 1, executor).on(cut(mosaic, (131, 77)))
    np.testing.assert_array_equal(vote.corner, (131, 77))


def test_what_repeats_itself_has_a_rival(texture_of, executor):
    tile = texture_of(18, 24, 9).astype(np.float32)
    reference = np.tile(tile, (5, 5))
    vote = GlobalVote(reference, 0.3, 1, executor).on(reference)
    assert vote.rival > ALONE


def test_what_shows_something_else_is_not_sure(texture_of, executor):
    vote = GlobalVote(texture_of(*SHAPE, 1).astype(np.float32), 0.3, 1, executor).on(
        texture_of(*SHAPE, 2).astype(np.float32)
    )
    assert vote.mean < SURE


def test_nothing_to_vote_on_is_no_vote(executor):
    flat = np.full(SHAPE, 90.0, np.float32)
    vote = GlobalVote(flat, 0.3, 1, executor).on(flat)
    np.testing.assert_array_equal(vote.corner, (0, 0))
    assert (vote.mean, vote.rival) == (0.0, 1.0)


def test_an_unsure_vote_is_repeated_at_full_size(executor):
    pairs = np.random.default_rng(3).normal(0.0, 30.0, (85, 110))
    scene = 128.0 + np.kron(pairs, [[1.0, -1.0], [-1.0, 1.0]]).astype(np.float32)
    shape = (100, 140)
    reference, live = cut(scene, (30, 30), shape), cut(scene, (39, 25), shape)
    search = CoarseSearch(reference, Grid(shape, shape, 130.0), 0.3, executor)
    np.testing.assert_array_equal(search.match(live).offset, (9, -5))  # flat at half the size
