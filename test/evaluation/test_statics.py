"""What is said of static objects, one by one and in a table."""

import math

import numpy as np
import pytest

from rsmb_ros.evaluation.case import Case, TrueMotion
from rsmb_ros.evaluation.methods import Outcome
from rsmb_ros.evaluation.metrics import ObjectScores, PixelScores, RegistrationScores, Score
from rsmb_ros.evaluation.static_table import HEAD, static_table
from rsmb_ros.evaluation.statics import StaticObject, static_objects

SHAPE = (120, 160)
HOUSE, TREE = (20, 30, 40, 30), (80, 100, 20, 20)  # row, column, rows, columns


def mask(*boxes):
    drawn = np.zeros(SHAPE, bool)
    for row, col, rows, cols in boxes:
        drawn[row : row + rows, col : col + cols] = True
    return drawn


def case(label=None, **about):
    layers = np.zeros(SHAPE, np.uint8)
    layers[mask(HOUSE)], layers[mask(TREE)] = 1, 2
    live = np.full(SHAPE, 90, np.uint8)
    live[:, :90] += (4 * (np.arange(90) % 5)).astype(np.uint8)  # stripes, on the house only
    centroids = np.zeros((SHAPE[0], 6))
    centroids[:, :2] = 6.0, 8.0
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    motion = TrueMotion(np.dstack([x, y]), centroids, layers, (0.8, 0.5), 20.0)
    nothing = np.zeros(SHAPE, np.uint8)
    return Case(
        'layered/0', live, live, nothing if label is None else label, nothing, None, motion, about
    )


def outcome(*depths, registered=True):
    known = tuple((mask(box), depth) for box, depth in depths)
    return Outcome(registered, '', mask(), ~mask(), None, 0.1, depths=known)


def test_depth_is_that_of_the_region_that_matches_best():
    pieces = ((20, 30, 40, 12), 0.3), ((18, 28, 42, 34), 0.81), ((90, 10, 20, 20), 0.6)
    house, tree = static_objects(outcome(*pieces), case(blur_px=7.0), mask())
    assert (house.depth, house.found, house.blur_px) == (0.8, 0.81, 7.0)
    assert house.error == pytest.approx(0.01)
    assert tree.depth == 0.5
    assert math.isnan(tree.found)
    assert math.isnan(tree.error)


def test_piece_of_an_object_is_not_the_object():
    house, _ = static_objects(outcome(((20, 30, 40, 6), 0.8)), case(), mask())
    assert math.isnan(house.found)


def test_texture_and_parallax_are_measured():
    house, tree = static_objects(outcome(), case(), mask())
    assert house.texture > 2
    assert tree.texture == 0
    assert house.parallax_px == pytest.approx(2.5)  # 10 px (1 / .8 - 1)
    assert tree.parallax_px == pytest.approx(10)


@pytest.mark.parametrize(
    ('box', 'called'),
    [((22, 32, 10, 10), True), ((22, 6, 10, 34), False), ((22, 32, 1, 3), False)],
    ids=['on it', 'beside it', 'a few pixels'],
)
def test_change_that_lies_on_an_object_is_blamed_on_it(box, called):
    house, tree = static_objects(outcome(), case(), mask(box))
    assert (house.as_change, tree.as_change) == (called, False)


def test_true_change_on_an_object_is_no_alarm():
    label = np.where(mask((25, 35, 5, 5)), 255, 0).astype(np.uint8)
    house, _ = static_objects(outcome(), case(label), mask((22, 32, 10, 10)))
    assert not house.as_change


def test_object_half_outside_the_reference_is_left_out():
    label = np.where(mask((0, 40, 120, 120)), 85, 0).astype(np.uint8)
    assert static_objects(outcome(), case(label), mask()) == ()


def test_nothing_is_said_without_registration_or_truth():
    assert static_objects(outcome(registered=False), case(), mask()) == ()
    nothing = np.zeros(SHAPE, np.uint8)
    assert static_objects(outcome(), Case('a/0', *[nothing] * 4), mask()) == ()


def thing(found=0.8, texture=6.0, parallax=5.0, blur=10.0, as_change=False):
    return StaticObject(0.8, found, texture, parallax, blur, as_change)


def scored(*statics, method='rsmb', name='layered/0'):
    nothing = ObjectScores(0, 0, 0, 0)
    return Score(
        name, method, True, True, '', 0.1, PixelScores(), nothing, nothing, RegistrationScores(),
        statics,
    )  # fmt: skip


def test_table_says_how_many_and_how_well():
    scores = [
        scored(thing(0.81), thing(0.9, texture=2.0), thing(math.nan, parallax=0.5)),
        scored(thing(0.8, as_change=True), thing(0.8, blur=21.0, as_change=True)),
        scored(thing(0.1), method='ecc'),
        scored(name='planar/0'),
    ]
    table = static_table(scores, 'rsmb')
    assert tuple(table.head) == HEAD
    assert table.rows == [
        ['layered', 'all', '5', '80', '0.005 / 0.073', '75', '1 of 4'],
        ['layered', 'texture < 5', '1', '100', '0.100 / 0.100', '0', '0 of 1'],
        ['layered', 'texture >= 5', '4', '75', '0.000 / 0.008', '100', '1 of 3'],
        ['layered', 'parallax < 1 px', '1', '0', '-', '-', '0 of 1'],
        ['layered', 'parallax >= 3 px', '4', '100', '0.005 / 0.073', '75', '1 of 3'],
    ]


def test_no_table_without_static_objects():
    assert static_table([scored()], 'rsmb') is None
