"""One object is one place, however often it is seen; flickers cannot fill the memory."""

import numpy as np

from rsmb_ros.report.flight.places import MOST_TRACKED, Box, PlaceBook


def box_of(region):
    return Box(region.x, region.y, region.x + region.width, region.y + region.height)


def test_an_object_in_two_hundred_frames_is_one_place(region):
    book = PlaceBook('change')
    rng = np.random.default_rng(20170303)
    for n in range(200):
        dx, dy = rng.integers(-3, 4, 2)
        one = region(100 + int(dx), 50 + int(dy), score=0.5 + 0.4 * (n == 120))
        book.sight(one, box_of(one), 0, n)
        far = region(10, 10, score=0.4)
        book.sight(far, box_of(far), 0, n)
    first, second = book.ranked()
    assert (first.frames, first.first, first.last) == (200, 0, 199)
    assert (first.best_frame, first.best.score) == (120, 0.9)
    assert second.frames == 200
    assert book.dropped == 0


def test_pieces_of_one_object_are_one_sighting(region):
    book = PlaceBook('change')
    whole = region(100, 50, 40, 20)
    book.sight(whole, box_of(whole), 0, 0)
    for piece in (region(100, 50, 15, 20), region(125, 50, 15, 20)):
        book.sight(piece, box_of(piece), 0, 1)
    (place,) = book.ranked()
    assert place.frames == 2


def test_places_of_two_references_are_two(region):
    book = PlaceBook('change')
    one = region(100, 50)
    for reference in (0, 1):
        book.sight(one, box_of(one), reference, reference)
    assert len(book.ranked()) == 2


def test_an_id_goes_before_the_place(region):
    book = PlaceBook('change')
    for n, x in enumerate((10, 60, 110)):
        driving = region(x, 50, id=7)
        book.sight(driving, box_of(driving), 0, n)
    other = region(110, 50, id=8)
    book.sight(other, box_of(other), 0, 3)
    assert sorted(place.frames for place in book.ranked()) == [1, 3]


def test_flickers_are_forgotten_for_what_lasts(region):
    book = PlaceBook('change')
    lasting = region(5, 5, score=0.6)
    for n in range(1000):
        book.sight(lasting, box_of(lasting), 0, n)
        flicker = region(100 + 50 * n, 50, score=0.5)
        book.sight(flicker, box_of(flicker), 0, n)
    real = region(0, 500, score=0.95)
    book.sight(real, box_of(real), 0, 1000)
    ranked = book.ranked()
    assert len(ranked) == MOST_TRACKED['change']
    assert book.dropped == 1002 - len(ranked)
    assert [place.best.score for place in ranked[:2]] == [0.6, 0.95]
    assert ranked[0].frames == 1000


def test_a_place_that_is_not_known_is_its_own(region):
    book = PlaceBook('change')
    for n in range(3):
        book.sight(region(5, 5), None, 0, n)
    assert len(book.ranked()) == 3


def test_box_of_unknown_points_is_unknown():
    assert Box.around(np.array([[1.0, np.nan], [2, 3]])) is None
    assert Box.around(np.array([[1.0, 5], [2, 3]])) == Box(1.0, 3.0, 2.0, 5.0)
