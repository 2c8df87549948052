"""Of a stream without a known end, the right items are kept, and not more of them."""

import numpy as np
import pytest

from rsmb_ros.report.flight.keeping import Highest, Thinned


@pytest.mark.parametrize('count', [0, 1, 7, 8, 9, 64, 1000, 1023])
def test_thinned_is_even_bounded_and_has_the_first(count):
    thinned = Thinned(8)
    for n in range(count):
        thinned.offer(lambda n=n: n)
    kept = list(thinned)
    assert len(kept) == len(thinned) <= 8
    assert len(kept) >= min(count, 4)
    if count > 1:
        assert kept[0] == 0
        step = kept[1] - kept[0]
        assert (np.diff(kept) == step).all()
        assert count - kept[-1] <= 2 * step  # to the end of the stream


def test_thinned_makes_only_what_it_keeps_for_a_while():
    made = []
    thinned = Thinned(8)
    for n in range(10_000):
        thinned.offer(lambda n=n: made.append(n) or n)
    assert len(made) < 80  # eight and four a doubling


def test_highest_are_those_that_sorting_gives():
    rng = np.random.default_rng(20170301)
    scores = rng.integers(0, 40, 500) / 10  # with ties
    highest = Highest(12)
    for n, score in enumerate(scores):
        highest.offer(score, lambda n=n: n)
    order = sorted(range(500), key=lambda n: (-scores[n], n))
    assert list(highest) == sorted(order[:12])


def test_highest_makes_only_what_it_keeps():
    made = []
    highest = Highest(3)
    for score in (3, 2, 1, 0, 1, 2):
        highest.offer(score, lambda score=score: made.append(score))
    assert made == [3, 2, 1, 2]
    assert len(highest) == 3
