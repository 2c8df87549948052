"""What static objects hide of the background, and what of them is not judged."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from known_frame import displacement, known_frame

from rsmb_ros.core import Config, warm_up
from rsmb_ros.core import layers as layers_module
from rsmb_ros.core.layers import Fronts, Layer, Place
from rsmb_ros.core.render import Window
from rsmb_ros.core.segmentation import Blob
from rsmb_ros.core.synthesis import Scene, Sheet
from rsmb_ros.core.workers import workers

SHAPE = (240, 320)
DEPTH = 0.8
ONE = workers(1)


@pytest.fixture(scope='module')
def ground(texture_of):
    return texture_of(SHAPE[0] + 80, SHAPE[1] + 80, 12)


def box(texture_of, depth, x=120.0, y=80.0, seed=31):
    texture = 255 - texture_of(70, 90, seed)
    return Sheet(texture, np.ones(texture.shape, np.float32), x, y, depth, 'box')


def layer_of(found, place, number=1):
    """The layer that a perfect search returns: where the object is in the live frame."""
    rows, cols = np.nonzero(found.truth.layers == number)
    box = np.s_[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    mask = (found.truth.layers == number)[box]
    return Layer(Blob(mask, int(cols.min()), int(rows.min())), mask, place, 1.0)


@pytest.fixture
def boxed(ground, texture_of, executor):
    return known_frame(Scene(ground, 40, (box(texture_of, DEPTH),)), executor)


def masks(found, layers, executor):
    inside, edge = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    for front in Fronts(found.frame.path, ONE).of(layers):
        inside[front.window.box] |= front.inside
        edge[front.window.box] |= front.edge
    return inside, edge


def eroded(mask, size):
    return cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def dilated(mask, size):
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def test_inside_is_covered_and_edge_is_around_it(boxed, executor):
    on = boxed.truth.layers > 0
    inside, edge = masks(boxed, [layer_of(boxed, Place(DEPTH))], executor)
    assert not np.any(inside & edge)
    assert not np.any(inside & ~on), 'surely covered, so never ground'
    # half of EDGE all around, and what blurs over it during the exposure
    assert inside[eroded(on, 23)].all()
    assert not np.any(~dilated(on, 41) & (inside | edge))
    rim = dilated(on, 7) & ~eroded(on, 7)
    assert edge[rim].all(), 'an outline is not known to a pixel'


def test_what_an_object_uncovers_is_edge_too(boxed, executor):
    """Where the reference shows the object and the live frame the ground behind it."""
    _, edge = masks(boxed, [layer_of(boxed, Place(DEPTH))], executor)
    on = boxed.truth.layers > 0
    expected = (boxed.truth.places[..., 0] >= 120) & (boxed.truth.places[..., 0] < 210)
    expected &= (boxed.truth.places[..., 1] >= 80) & (boxed.truth.places[..., 1] < 150)
    uncovered = expected & ~on
    assert np.count_nonzero(uncovered) > 400
    assert edge[uncovered].all()


def test_what_is_not_sure_is_edge(boxed, executor):
    layer = layer_of(boxed, Place(DEPTH))
    sure = layer.sure.copy()
    sure[:, : sure.shape[1] // 2] = False
    inside, edge = masks(boxed, [replace(layer, sure=sure)], executor)
    middle = layer.blob.x + layer.blob.mask.shape[1] // 2
    assert not inside[:, : middle - 1].any()
    assert inside[:, middle + 12 :].any()
    left = eroded(boxed.truth.layers > 0, 15)
    left[:, middle - 1 :] = False
    assert edge[left].all()


def test_pieces_at_one_place_are_one_front_and_others_come_farthest_first(boxed, executor):
    whole = layer_of(boxed, Place(DEPTH))
    half = whole.blob.mask.copy()
    half[:35] = False
    upper = replace(
        whole, blob=replace(whole.blob, mask=whole.blob.mask & ~half), sure=whole.sure & ~half
    )
    lower = replace(
        whole, blob=replace(whole.blob, mask=whole.blob.mask & half), sure=whole.sure & half
    )
    behind = replace(whole, place=Place(1.2))
    found = Fronts(boxed.frame.path, ONE).of([upper, behind, lower])
    assert [front.place.relative_depth for front in found] == [1.2, DEPTH]
    alone = Fronts(boxed.frame.path, ONE).of([whole])[0]
    one = found[1]
    full = np.zeros((2, *SHAPE), bool)
    for part, front in zip(full, (alone, one), strict=True):
        part[front.window.box] = front.inside
    assert np.count_nonzero(full[0] ^ full[1]) < 0.02 * np.count_nonzero(full[0])


def test_a_layer_in_front_is_shown_and_its_edge_is_not_judged(boxed, executor):
    frame = boxed.frame
    layer = layer_of(boxed, Place(DEPTH, misfit=1.7))
    inside, edge = masks(boxed, [layer], executor)
    before, judged = frame.residual.copy(), frame.judged.copy()
    frame.put_in_front([layer])
    assert before[inside].std() > 3 * frame.residual[inside].std()
    assert frame.residual[inside].std() < 5.0
    assert not frame.judged[edge].any()
    np.testing.assert_array_equal(frame.judged[~edge], judged[~edge])
    np.testing.assert_array_equal(frame.residual[~inside], before[~inside])
    np.testing.assert_allclose(frame.misfit, np.where(inside, np.float32(1.7), np.float32(1.0)))


def test_a_shift_moves_what_is_shown(ground, texture_of, executor):
    before, after = (box(texture_of, DEPTH, x=120.0 + dx) for dx in (0.0, 1.5))
    found = known_frame(Scene(ground, 40, (before,)), executor, after=Scene(ground, 40, (after,)))
    frame, on = found.frame, eroded(found.truth.layers > 0, 35)
    frame.put_in_front([layer_of(found, Place(DEPTH))])
    unmoved = frame.residual[on].std()
    frame.put_in_front([layer_of(found, Place(DEPTH, (-1.5, 0.0)))])
    assert frame.residual[on].std() < 0.5 * unmoved


def test_what_a_layer_shows_from_beyond_the_reference_is_not_judged(ground, texture_of, executor):
    """Near objects move more than the ground: their part of the reference may end before it."""
    found = known_frame(Scene(ground, 40, (box(texture_of, 0.75, x=250.0),)), executor)
    layer = layer_of(found, Place(0.75))
    frame = found.frame
    complete = frame.render(0.75, Window(0, SHAPE[0], 0, SHAPE[1])).complete
    beyond = (found.truth.layers > 0) & ~complete & frame.judged
    assert np.count_nonzero(beyond) > 100, 'else there is nothing to judge wrongly'
    frame.put_in_front([layer])
    assert not frame.judged[beyond].any()
    assert frame.judged[:40].any()
    assert frame.judged[200:, 200:].any(), 'far from the object the border is judged'


def test_a_front_is_worked_out_once(boxed):
    first, second = layer_of(boxed, Place(DEPTH)), layer_of(boxed, Place(1.2))
    known = Fronts(boxed.frame.path, ONE)
    (front,) = known.of([first])
    assert known.of([first, second])[1] is front
    assert known.of([replace(first)])[0] is not front


@pytest.mark.parametrize('side', ['left', 'right', 'top', 'bottom'])
def test_a_gap_at_the_edge_of_the_frame_belongs_to_what_goes_on_beyond_it(boxed, executor, side):
    """Two walls of a house that only shows in part, the roof between them like the ground."""
    walls = np.zeros((28, 40), bool)
    walls[:9] = walls[-9:] = True
    x, y = {'left': (5, 60), 'right': (SHAPE[1] - 45, 60), 'top': (90, 5), 'bottom': (90, 0)}[side]
    if side in ('top', 'bottom'):
        walls = walls.T
        y = 5 if side == 'top' else SHAPE[0] - 45
    layer = Layer(Blob(walls, x, y), walls, Place(0.97), 1.0)
    inside, edge = masks(boxed, [layer], executor)
    roof = np.zeros(SHAPE, bool)
    roof[y : y + walls.shape[0], x : x + walls.shape[1]] = True
    assert (inside | edge)[roof].mean() > 0.97


def test_a_window_is_no_larger_than_its_masks(boxed):
    (front,) = Fronts(boxed.frame.path, ONE).of([layer_of(boxed, Place(DEPTH))])
    touched = front.inside | front.edge
    assert all(side.any() for side in (touched[0], touched[-1], touched[:, 0], touched[:, -1]))
    core = front.inside[front.core]
    assert np.count_nonzero(core) == np.count_nonzero(front.inside)
    assert all(side.any() for side in (core[0], core[-1], core[:, 0], core[:, -1]))


def test_a_layer_of_which_nothing_is_sure_is_only_not_judged(boxed):
    layer = layer_of(boxed, Place(DEPTH))
    frame, before = boxed.frame, boxed.frame.predicted.copy()
    frame.put_in_front([replace(layer, sure=np.zeros_like(layer.sure))])
    np.testing.assert_array_equal(frame.predicted, before)
    assert not frame.judged[boxed.truth.layers > 0].any()


def test_at_a_slight_parallax_only_where_it_matters_an_outline_is_not_judged(
    ground, texture_of, executor
):
    """Less than a pixel or two: object and ground next to each other may look the same in both."""
    near = known_frame(Scene(ground, 40, (box(texture_of, 0.97),)), executor)
    layer = layer_of(near, Place(0.97))
    (front,) = Fronts(near.frame.path, ONE).of([layer])
    assert front.slight
    own, _, complete = near.frame.render(0.97, front.window)
    unknown = front.unknown(own, complete, near.frame.predicted[front.window.box])
    apart = np.abs(own - near.frame.predicted[front.window.box]) > 10.0
    assert unknown[front.edge & apart].all()
    assert not unknown[~front.edge].any()
    assert 0.2 < np.count_nonzero(unknown) / np.count_nonzero(front.edge) < 0.9
    (far,) = Fronts(near.frame.path, ONE).of([replace(layer, place=Place(0.8))])
    assert not far.slight
    own, _, complete = near.frame.render(0.8, far.window)
    same = far.unknown(own, complete, own)
    np.testing.assert_array_equal(same, far.edge | (far.inside & ~complete))


def test_parallax_is_how_far_a_layer_lies_from_its_place_on_the_ground(boxed):
    layer = layer_of(boxed, Place(DEPTH, (1.5, -0.5)))
    (front,) = Fronts(boxed.frame.path, ONE).of([layer])
    x, y = displacement(boxed, layer.blob, DEPTH)
    assert front.parallax == pytest.approx(np.hypot(x + 1.5, y - 0.5), abs=0.5)


@pytest.mark.parametrize('estimator', ['path', 'rows'])
def test_warming_up_compiles_the_kernels_of_fronts(monkeypatch, estimator):
    """A frame without static objects, as there, does not come to them by itself."""
    ran = []
    for name in ('draw_masks', 'watch_cover'):
        kernel = getattr(layers_module, name)
        monkeypatch.setattr(
            layers_module, name, lambda *a, n=name, k=kernel: (ran.append(n), k(*a))
        )
    warm_up(Config().replaced({'registration.estimator': estimator}))
    assert set(ran) == {'draw_masks', 'watch_cover'}
