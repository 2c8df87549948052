"""Work on one frame is shared without gaps, and its errors are not lost."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.workers import SMALL, Workers, beside, each, shared, workers


@pytest.mark.parametrize('threads', [1, 2, 7])
@pytest.mark.parametrize('rows', [0, 1, 5, 480])
@pytest.mark.parametrize('work', [1, SMALL])
def test_each_row_is_done_once(threads, rows, work):
    done = np.zeros(rows, np.int64)

    def run(first, last):
        done[first:last] += 1

    with Workers(threads) as workers:
        shared(workers, run, rows, work)
    assert np.all(done == 1)


def test_an_error_of_any_thread_is_raised():
    def run(first, last):
        if first <= 50 < last:
            raise ValueError('row 50')

    with Workers(3) as workers:
        for _ in range(20):  # whoever takes that block
            with pytest.raises(ValueError, match='row 50'):
                shared(workers, run, 100, SMALL)


@pytest.mark.parametrize('threads', [1, 2, 7])
@pytest.mark.parametrize('count', [0, 1, 50])
def test_results_come_in_the_order_of_their_items(threads, count):
    with Workers(threads) as workers:
        assert each(workers, lambda n: n * n, range(count)) == [n * n for n in range(count)]


@pytest.mark.parametrize('threads', [1, 2])
def test_a_task_beside_is_done_once_whoever_does_it(threads):
    done = []

    def task():
        done.append(threading.get_ident())
        return 'done'

    with Workers(threads) as workers:
        assert beside(workers, task)() == 'done'
        stop = threading.Event()
        busy = [workers.submit(stop.wait, 30.0) for _ in range(threads)]
        try:
            assert beside(workers, task)() == 'done', 'all others are busy'
        finally:
            stop.set()
        assert all(one.result() for one in busy)
    assert len(done) == 2
    assert done[1] == threading.get_ident()


def test_all_detectors_share_their_threads(texture_of):
    image = texture_of(64, 80, 1)
    two, again, one = (
        Detector(image, config=Config().replaced({'worker.threads': count}))._executor
        for count in (2, 2, 1)
    )
    assert two is again is workers(2)
    assert one is not two
