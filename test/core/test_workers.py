"""Work on one frame is shared without gaps, and its errors are not lost."""

from __future__ import annotations

import threading
import time
from functools import partial

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
        begun, stop = threading.Semaphore(0), threading.Event()

        def occupy():
            begun.release()
            return stop.wait(30.0)

        busy = [workers.ask(occupy) for _ in range(workers.helpers)]
        assert all(begun.acquire(timeout=30.0) for _ in busy)
        try:
            assert beside(workers, task)() == 'done', 'all others are busy'
        finally:
            stop.set()
        assert all(one.result() for one in busy)
    assert len(done) == 2
    assert done[1] == threading.get_ident()


def test_who_waits_for_a_task_does_what_others_ask_meanwhile():
    """Else a task that asks for help would wait for one that waits for it."""
    begun, done = threading.Event(), []

    def asking(workers):
        inner = workers.ask(lambda: done.append(threading.get_ident()))
        begun.set()
        deadline = time.monotonic() + 30.0
        while not inner.done and time.monotonic() < deadline:
            time.sleep(1e-3)
        return inner.done

    with Workers(2) as workers:
        outer = workers.ask(lambda: asking(workers))
        assert begun.wait(30.0)
        assert outer.result()
    assert done == [threading.get_ident()]


def test_threads_that_sleep_wake_for_the_next_task(monkeypatch):
    monkeypatch.setattr('rsmb_ros.core.workers.TURNS', 1)
    with Workers(3) as workers:
        for _ in range(5):
            deadline = time.monotonic() + 30.0
            while workers._awake and time.monotonic() < deadline:
                time.sleep(1e-3)
            assert workers._awake == 0, 'a thread without work does not sleep'
            begun = threading.Barrier(3)  # only three threads at once get past it
            asked = [workers.ask(partial(begun.wait, 30.0)) for _ in range(2)]
            begun.wait(30.0)
            assert len({one.result() for one in asked}) == 2


def test_an_error_of_a_task_beside_is_raised_where_its_result_is_asked_for():
    def task():
        raise ValueError('of the task')

    with Workers(2) as workers:
        waited = beside(workers, task)
        for _ in range(2):
            with pytest.raises(ValueError, match='of the task'):
                waited()


@pytest.mark.parametrize('threads', [2, 5])
def test_nothing_is_lost_or_done_twice_when_many_ask_at_once(threads):
    def sum_of(n):
        return sum(each(workers, lambda k: k * k, range(n)))

    with Workers(threads) as workers:
        for _ in range(20):
            assert each(workers, sum_of, range(12)) == [
                sum(k * k for k in range(n)) for n in range(12)
            ]


def test_the_most_work_is_begun_first():
    begun = []
    with Workers(1) as workers:
        items = (3, 9, 1, 5)
        assert each(workers, lambda n: begun.append(n) or n, items, lambda n: n) == [3, 9, 1, 5]
    assert begun == [9, 5, 3, 1]


def test_all_detectors_share_their_threads(texture_of):
    image = texture_of(64, 80, 1)
    two, again, one = (
        Detector(image, config=Config().replaced({'worker.threads': count}))._executor
        for count in (2, 2, 1)
    )
    assert two is again is workers(2)
    assert one is not two
