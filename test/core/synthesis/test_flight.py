"""Drawn scenes and flights over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    CHANGED,
    GONE,
    SUBURB,
    USUAL,
    FlightPlan,
    Scene,
    Style,
    SyntheticFlight,
    aerial_scene,
    placed_objects,
)
from rsmb_ros.core.synthesis.aerial import free_place
from rsmb_ros.core.synthesis.flight import MIN_CONTRAST, contrast, roofed

SHAPE = (240, 320)
PLAN = FlightPlan(3, 5.0, 6.0, 4.0, ShutterTiming(30.0), 2, USUAL, 5, 0.3)


def test_equal_seeds_give_equal_scenes():
    first, second = (aerial_scene(SHAPE, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first.background, second.background)
    assert [layer.x for layer in first.layers] == [layer.x for layer in second.layers]
    other = aerial_scene(SHAPE, np.random.default_rng(6))
    assert np.any(first.background != other.background)


def test_texture_is_the_contrast_of_the_ground():
    bare = Style(houses=0, roads=0.0, trees=0)
    styles = [replace(bare, texture=texture) for texture in (0.05, 0.3, 1.0)]
    grounds = [aerial_scene(SHAPE, np.random.default_rng(2), 0, s).background for s in styles]
    strengths = [ground.mean(axis=2).std() for ground in grounds]
    assert strengths == sorted(strengths)
    assert strengths[0] < 0.2 * strengths[2]


def test_nearer_layers_hide_farther_ones():
    style = Style(houses=2, crowns=6)
    depths = [
        layer.relative_depth
        for layer in aerial_scene((480, 640), np.random.default_rng(1), 20, style).layers
    ]
    assert len(depths) >= 6
    assert depths == sorted(depths, reverse=True)


def test_objects_lie_apart_on_free_ground_and_stand_out():
    scene = aerial_scene((480, 640), np.random.default_rng(8), 20, SUBURB)
    objects = placed_objects(scene, 5, np.random.default_rng(9))
    assert len(objects) == 5
    covered = roofed(scene).astype(int)
    for sheet in objects:
        box = np.s_[
            int(sheet.y) : int(sheet.y) + sheet.cover.shape[0],
            int(sheet.x) : int(sheet.x) + sheet.cover.shape[1],
        ]
        covered[box] += 1
        assert contrast(sheet, scene, sheet.x, sheet.y) >= MIN_CONTRAST
    assert covered.max() == 1


def test_no_place_is_found_on_a_full_ground():
    assert free_place(np.ones((100, 100), bool), (10, 10), np.random.default_rng(0)) is None
    assert free_place(np.zeros((100, 100), bool), (10, 200), np.random.default_rng(0)) is None


def test_grey_ground_gets_grey_objects(texture_of):
    scene = Scene(texture_of(280, 360, 3), 20)
    assert all(
        sheet.texture.ndim == 2 for sheet in placed_objects(scene, 2, np.random.default_rng(1))
    )


def test_equal_plans_give_equal_flights():
    for one, other in zip(*(SyntheticFlight(PLAN, SHAPE).frames() for _ in range(2)), strict=True):
        np.testing.assert_array_equal(one.live, other.live)


def test_objects_appear_one_after_the_other():
    counts = [
        len(frame.truth.names)
        for frame in SyntheticFlight(replace(PLAN, frames=6, nuisances=USUAL), SHAPE).frames()
    ]
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 2)


def test_vanished_objects_are_changed_in_every_frame():
    flight = SyntheticFlight(replace(PLAN, objects=0, vanished=1), SHAPE)
    assert all((frame.truth.label == CHANGED).any() for frame in flight.frames())
    assert [sheet.kind for sheet in flight._gone] == [GONE]


def test_photo_is_the_reference_unaltered(texture_of):
    photo = texture_of(*SHAPE, 9)
    flight = SyntheticFlight(replace(PLAN, frames=1), SHAPE, photo)
    np.testing.assert_array_equal(flight.reference, photo)
    (frame,) = flight.frames()
    assert frame.live.shape == photo.shape


@pytest.mark.parametrize('motion', ['smooth', 'jello', 'walk', 'constant'])
def test_every_motion_bends_the_rows_as_far_as_it_blurs(motion):
    (frame,) = SyntheticFlight(replace(PLAN, frames=1, motion=motion), SHAPE).frames()
    speed = np.hypot(*np.diff(frame.truth.centroids[:, :2], axis=0).T)
    assert 0.2 < np.median(speed) * 30.0 / 4.0 < 1.3  # the rest of the 4 px is rotation and tilt
