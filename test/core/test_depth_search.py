"""What a depth may explain, and what it may not, on frames whose path is known."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import cv2
import numpy as np
import pytest
from known_frame import displacement, known_frame

from rsmb_ros.core import depth_search
from rsmb_ros.core.layers import Layer, Place
from rsmb_ros.core.segmentation import Blob, blobs
from rsmb_ros.core.synthesis import CHANGED, NEW, Scene, Sheet

MARGIN = 40
SHAPE = (240, 320)
HOUSE = np.s_[80:150, 120:210]  # of the reference


@pytest.fixture(scope='module')
def ground(texture_of):
    return texture_of(SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN, 5)


def roof(depth, seed=1, place=HOUSE, grain=12.0, **change):
    """A roof with rows of tiles and a bright and a dark half, like no ground."""
    height, width = (part.stop - part.start for part in place)
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 150.0)
    image[height // 2 :] = 105.0
    image[::7] -= 25.0
    image[:, ::9] -= 15.0
    for _ in range(6):
        x, y = rng.integers(0, width - 14), rng.integers(0, height - 12)
        image[y : y + 12, x : x + 14] = rng.uniform(40, 220)
    image += cv2.GaussianBlur(rng.normal(0, grain, image.shape), (0, 0), 1.5)
    texture = np.clip(image, 0, 255).astype(np.uint8)
    sheet = Sheet(
        texture, np.ones(texture.shape, np.float32), place[1].start, place[0].start, depth, 'roof'
    )
    return replace(sheet, **change)


def scene(ground, *layers):
    return Scene(ground, MARGIN, tuple(layers))


def largest(found, place):
    return max(found.blobs_on(place), key=lambda blob: blob.area)


def cover_of(layer):
    """Where a layer is (M, N) bool, nowhere for None."""
    cover = np.zeros(SHAPE, bool)
    if layer is not None:
        cover[layer.blob.box] = layer.blob.mask
    return cover


@pytest.fixture(scope='module')
def houses(ground, executor):
    """Frames of the same house at several depths, nothing new."""
    return {
        depth: known_frame(scene(ground, roof(depth)), executor)
        for depth in (0.75, 0.86, 0.93, 1.2)
    }


@pytest.mark.parametrize('depth', [0.75, 0.86, 0.93, 1.2])
def test_depth_of_a_static_object_is_found_at_first_look(houses, depth):
    found = houses[depth]
    layer = found.search.explain(largest(found, found.truth.layers > 0))
    assert abs(layer.place.relative_depth - depth) < 0.02
    assert layer.share > 0.6


SMALL_HOUSE = np.s_[80:120, 120:170]


def test_what_an_object_uncovers_does_not_count_against_it(ground, executor, monkeypatch):
    """Nothing at its depth explains that, however large the parallax makes it."""
    found = known_frame(scene(ground, roof(0.6, place=SMALL_HOUSE)), executor)
    house = found.truth.layers > 0
    blob = largest(found, house)
    window, mask = found.search._windowed(blob)
    covered = found.search._covered(mask, window, 0.6)
    own = house[window.box]
    assert np.count_nonzero(mask) > 1.6 * np.count_nonzero(own)
    assert np.count_nonzero(covered & own) > 0.95 * np.count_nonzero(own)
    assert np.count_nonzero(covered) < 1.3 * np.count_nonzero(own)
    layer = found.search.explain(blob)
    monkeypatch.setattr(depth_search, 'MIN_COVERED', 2.0)  # ask for the whole mask
    whole = found.search.explain(blob)
    assert whole.share < depth_search.SURE_SHARE < layer.share
    assert abs(layer.place.relative_depth - 0.6) < 0.02


@pytest.mark.parametrize('depths', [(0.92, 0.8), (0.8, 0.92)])
def test_two_roofs_in_one_outline_are_explained_one_by_one(ground, executor, monkeypatch, depths):
    places = np.s_[80:150, 80:160], np.s_[80:150, 158:228]
    roofs = [
        roof(depth, n, place) for n, (depth, place) in enumerate(zip(depths, places, strict=True))
    ]
    found = known_frame(scene(ground, *roofs), executor)
    blob = largest(found, found.truth.layers > 0)
    monkeypatch.setattr(depth_search, 'MIN_CORRELATION', 0.95)  # so alike the two are at no depth
    first = found.search.explain(blob)
    assert min(abs(first.place.relative_depth - depth) for depth in depths) < 0.02
    monkeypatch.setattr(depth_search, 'PIECE_SHARE', 2.0)  # no piece is that large
    assert found.search.explain(blob) is None


@pytest.mark.parametrize('wrong', [0.5, 0.97, 1.3])
def test_all_depths_are_asked_where_a_neighbours_does_not_explain(houses, wrong):
    found = houses[0.86]
    blob = largest(found, found.truth.layers > 0)
    beside = np.ones((20, 20), bool)
    neighbour = Layer(Blob(beside, blob.x - 20, blob.y), beside, Place(wrong), 0.9)
    layer = found.search.explain(blob, [neighbour])
    assert abs(layer.place.relative_depth - 0.86) < 0.02


class Recorder:
    """Compares depths as `energy` does, and notes which it was asked for."""

    def __init__(self, energy):
        self.energy, self.asked = energy, []

    def best(self, window, mask, depths, reach):
        self.asked.extend(depths)
        return self.energy.best(window, mask, depths, reach)


def test_a_neighbours_depth_is_taken_before_all_others(houses):
    found = houses[0.86]
    blob = largest(found, found.truth.layers > 0)
    beside = np.ones((20, 20), bool)
    neighbour = Layer(Blob(beside, blob.x - 20, blob.y), beside, Place(0.87), 0.9)
    recorder = Recorder(found.search.energy)
    search, asked = replace(found.search, energy=recorder), recorder.asked
    layer = search.explain(blob, [neighbour])
    assert abs(layer.place.relative_depth - 0.86) < 0.02
    assert asked == [0.87]
    far_off = replace(neighbour, blob=replace(neighbour.blob, x=0, y=0))
    search.explain(blob, [far_off])
    assert min(asked) < 0.4


def layer_beside(blob, depth, gap):
    """A layer at `depth` of a blob's size, `gap` px left of it."""
    mask = np.ones(blob.mask.shape, bool)
    return Layer(Blob(mask, blob.x - blob.mask.shape[1] - gap, blob.y), mask, Place(depth), 0.9)


@pytest.mark.parametrize(
    ('depth', 'gap', 'static'),
    [(0.86, 20, True), (0.80, 20, False), (0.92, 20, False), (0.86, 80, False), (None, 0, False)],
)
def test_two_that_find_one_depth_need_to_show_less(houses, monkeypatch, depth, gap, static):
    found = houses[0.86]
    blob = largest(found, found.truth.layers > 0)
    explained = found.search.explain(blob).share * blob.area
    monkeypatch.setattr(depth_search, 'MIN_CORE', 1.5 * explained / found.mask.size)
    known = [] if depth is None else [layer_beside(blob, depth, gap)]
    assert (found.search.explain(blob, known) is not None) == static


@pytest.mark.parametrize(
    ('depth', 'moved'), [(0.97, (0.0, 1.0)), (0.97, (-0.8, 0.5)), (1.0, (0.8, -0.8))]
)
def test_an_object_a_pixel_beside_its_depths_place_is_static(ground, executor, depth, moved):
    """Tilt and translation look alike on the ground: t / d is then off by about as much."""
    house = roof(depth)
    after = replace(house, x=house.x + moved[0], y=house.y + moved[1])
    found = known_frame(scene(ground, house), executor, after=scene(ground, after))
    blob = largest(found, found.truth.layers > 0)
    layer = found.search.explain(blob)
    assert layer is not None
    place = displacement(found, blob, layer.place.relative_depth) + layer.place.shift
    true = displacement(found, blob, depth) - np.array(moved)
    assert np.hypot(*(place - true)) < 0.5


@pytest.mark.parametrize('moved', [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)])
def test_a_near_object_a_pixel_beside_its_depths_place_is_static(ground, executor, moved):
    house = roof(0.88)
    after = replace(house, x=house.x + moved[0], y=house.y + moved[1])
    found = known_frame(scene(ground, house), executor, after=scene(ground, after))
    on = found.truth.layers > 0
    layer = found.search.explain(largest(found, on))
    assert cover_of(layer)[on].mean() > 0.9


@pytest.mark.parametrize('moved', [(0.0, 5.0), (6.0, 0.0), (4.0, -4.0)])
def test_an_object_that_moved_farther_is_a_change(ground, executor, moved):
    house = roof(0.97)
    after = replace(house, x=house.x + moved[0], y=house.y + moved[1])
    found = known_frame(scene(ground, house), executor, after=scene(ground, after))
    on = found.truth.layers > 0
    assert found.blobs_on(on)
    explained = [found.search.explain(blob) for blob in found.blobs_on(on)]
    assert not any(layer is not None and layer.blob.area > 0.2 * on.sum() for layer in explained)


def new_things(kind, seed):
    """Four new objects of 26 x 40 px, apart from each other and from the house."""
    rng = np.random.default_rng(seed)
    for x, y in ((55, 30), (220, 35), (50, 180), (225, 175)):
        shape = (26, 40)
        if kind == 'plain':
            image = np.full(shape, rng.choice([15.0, 235.0])) + rng.normal(0, 3, shape)
        elif kind == 'stripes':
            image = 110.0 + 80.0 * np.sin(np.arange(40) * rng.uniform(0.5, 1.0)) * np.ones(shape)
        elif kind == 'grain':
            image = 120 + 3 * cv2.GaussianBlur(rng.normal(0, 60, shape), (0, 0), 1.5)
        else:
            image = np.full(shape, rng.choice([30.0, 220.0]))
            image[5:20, 8:30] = 120.0
            image[::6] += 20.0
        texture = np.clip(image, 0, 255).astype(np.uint8)
        yield Sheet(texture, np.ones(shape, np.float32), x, y, name=f'{kind} {x}', kind=NEW)


def test_what_nothing_explained_is_not_asked_again(ground, executor):
    thing = next(new_things('car', 1))
    found = known_frame(scene(ground, roof(0.88)), executor, [thing])
    recorder = Recorder(found.search.energy)
    search = replace(found.search, energy=recorder)
    blob = largest(found, found.truth.objects == 1)
    house = largest(found, found.truth.layers > 0)

    def questions(search, blob):
        before = len(recorder.asked)
        search.explain(blob)
        return len(recorder.asked) - before

    at_first = questions(search, blob)
    assert at_first > 10
    assert questions(search, blob) == 0
    grown = replace(blob, mask=np.pad(blob.mask, ((0, 0), (0, 1)), mode='edge'))
    assert questions(search, grown) == 0, 'as good as the same'
    half = replace(blob, mask=blob.mask[:, : blob.mask.shape[1] // 2])
    assert questions(search, half) == at_first, 'another object'
    for moved, again in ((0.1, 0), (0.6, at_first)):
        control = search.path.control.copy()
        control[:, 1] += moved
        frame = copy(found.frame)
        frame.fit = replace(frame.fit, path=replace(search.path, control=control))
        other = replace(search, frame=frame)
        assert questions(other, blob) == again, moved
    # what a depth explains is asked again: its path may have become another
    assert questions(search, house) == questions(search, house) > 10


@pytest.mark.parametrize('seed', [1, 2, 3])
@pytest.mark.parametrize('kind', ['plain', 'stripes', 'grain', 'car'])
def test_no_place_explains_a_new_object(ground, executor, kind, seed):
    objects = tuple(new_things(kind, seed))
    found = known_frame(scene(ground, roof(0.88)), executor, objects, seed=seed)
    for number in range(1, len(objects) + 1):
        thing = found.truth.objects == number
        assert found.mask[thing].mean() > 0.7, 'it stands out'
        for blob in found.blobs_on(thing):
            for known in ([], [layer_beside(blob, 0.88, 10)]):
                layer = found.search.explain(blob, known)
                assert cover_of(layer)[thing].mean() < 0.1, layer.place


def test_other_ground_does_not_explain_where_an_object_has_gone_from(executor, monkeypatch):
    """Plain ground looks like plain ground at any depth; only a static object stands out twice."""
    rng = np.random.default_rng(6)
    size = (SHAPE[0] + 2 * MARGIN, SHAPE[1] + 2 * MARGIN)
    grain = cv2.GaussianBlur(rng.normal(0, 4, size), (0, 0), 1.5)
    plain = np.clip(118 + grain, 0, 255).astype(np.uint8)
    white = np.full((22, 20), 235, np.uint8)
    gone = Sheet(white, np.ones(white.shape, np.float32), 150, 110, name='gone')
    found = known_frame(scene(plain, gone), executor, after=scene(plain))
    blob = largest(found, np.ones(SHAPE, bool))
    assert blob.area > 300
    assert found.search.explain(blob) is None
    monkeypatch.setattr(depth_search, 'MIN_DISPLACED', -1.0)
    assert found.search.explain(blob) is not None


@pytest.mark.parametrize('kind', ['plain', 'stripes', 'grain', 'car'])
def test_a_new_object_beside_a_house_is_no_part_of_it(ground, executor, kind):
    """The two make one candidate; the house's depth must not take the object along."""
    beside = replace(next(iter(new_things(kind, 4))), x=HOUSE[1].stop - 2, y=HOUSE[0].start + 20)
    found = known_frame(scene(ground, roof(0.88)), executor, [beside])
    thing = found.truth.label == CHANGED
    for blob in found.blobs_on(thing | (found.truth.layers > 0)):
        layer = found.search.explain(blob)
        if layer is None:
            continue
        covered = cover_of(layer)
        assert covered[thing].mean() < 0.15
        for rest in blobs(found.mask * ~covered):
            piece = found.search.belongs(rest, layer)
            if piece is not None:
                covered[piece.blob.box] |= piece.blob.mask
        assert covered[thing].mean() < 0.15


@pytest.mark.parametrize('depth', [0.75, 0.86, 0.93])
def test_what_an_object_uncovers_is_not_surely_part_of_it(ground, executor, depth):
    """On flat ground every depth explains the uncovered strip; the object's counterpart tells."""
    flat = ground.copy()
    yard = flat[90:230, 130:290]
    yard[:] = 120 + 0.08 * (yard.astype(float) - 120)
    found = known_frame(scene(flat, roof(depth)), executor)
    house = found.truth.layers > 0
    layer = found.search.explain(largest(found, house))
    beyond = cv2.dilate(house.astype(np.uint8), np.ones((7, 7)))[layer.blob.box] == 0
    uncovered = np.count_nonzero(layer.blob.mask & beyond)
    assert uncovered > 40, 'else there is nothing to tell apart'
    assert np.count_nonzero(layer.sure & beyond) < 0.2 * uncovered
    assert not np.any(layer.sure & ~layer.blob.mask)
    assert np.count_nonzero(layer.sure & house[layer.blob.box]) > 0.9 * np.count_nonzero(house)


@pytest.fixture(scope='module')
def paler_roof(ground, executor):
    """A roof of rich texture, less of it in the live frame; plain, and with a thing on it."""
    before = roof(0.88, grain=25.0)
    pale = 128 + 0.85 * (before.texture.astype(float) - 128)
    painted = pale.copy()
    painted[20:32, 36:54] -= 60.0  # of 125
    repainted = pale.copy()
    repainted[24:46, 30:60] = 30.0
    repainted[30:40, 36:54] = 200.0
    return {
        name: known_frame(
            scene(ground, before),
            executor,
            after=scene(ground, replace(before, texture=texture.astype(np.uint8))),
        )
        for name, texture in (
            ('plain', pale),
            ('painted', painted),
            ('repainted', repainted),
        )
    }


def test_rich_texture_may_fit_less_well_than_its_surroundings(paler_roof):
    found = paler_roof['plain']
    on = found.truth.layers > 0
    layer = found.search.explain(largest(found, on))
    assert abs(layer.place.relative_depth - 0.88) < 0.02
    assert layer.place.misfit > 1.5
    assert cover_of(layer)[on].mean() > 0.95


def test_a_new_object_stands_out_on_a_roof_that_fits_less_well(paler_roof):
    found = paler_roof['painted']
    layer = found.search.explain(largest(found, found.truth.layers > 0))
    assert layer.place.misfit > 1.5
    changed = np.abs(found.frame.grey - paler_roof['plain'].frame.grey) > 30
    assert np.count_nonzero(changed) > 100
    assert cover_of(layer)[changed].mean() < 0.2
    assert cover_of(layer)[found.truth.layers > 0].mean() > 0.7


def test_only_what_looks_alike_may_fit_less_well(paler_roof):
    """A large new thing on the same roof: nothing may be forgiven then."""
    found = paler_roof['repainted']
    layer = found.search.explain(largest(found, found.truth.layers > 0))
    assert layer is None or layer.place.misfit == 1.0
    changed = np.abs(found.frame.grey - paler_roof['plain'].frame.grey) > 30
    assert cover_of(layer)[changed].mean() < 0.1
