"""
Threads that share the work on one frame.

A frame is cut into hundreds of pieces of a tenth of a millisecond. A thread that sleeps takes half
of that to wake, so those that are out of work look for more for some milliseconds before they
sleep, as those of OpenMP do.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import count
from multiprocessing import current_process
from threading import Lock
from types import TracebackType
from typing import Generic, TypeVar, cast

import numpy as np

from ._kernels.wait import changed

PARTS = 8  # blocks that work is cut into: enough that nobody waits long for the last one
SMALL = 1 << 14  # px; handing out less than that takes longer than doing it
TURNS = 1 << 13  # times a thread without work looks for some before it sleeps, about 3 ms
NAP_S = 1e-4  # sleep of one that has looked so often for the end of what another thread does

TURN_S = 1e-4  # after which a thread that runs Python lets another one that waits do so

T = TypeVar('T')
R = TypeVar('R')


class Workers:
    """
    So many `threads`, the caller among them.

    What is asked of the others waits until one of them is free, or until the caller needs it and
    does it itself. Whoever waits does what others have asked meanwhile, so a task may ask, too.
    """

    def __init__(self, threads: int) -> None:
        self.helpers = threads - 1
        self._threads = ThreadPoolExecutor(max(1, self.helpers), 'rsmb')
        self._asked: deque[Task] = deque()
        self._awake = 0
        self._lock = Lock()
        # rung with another number whenever a task is asked or done, so that no stroke is missed
        self._bell = np.zeros(1, np.int64)
        self._strokes = count(1)

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._threads.shutdown()

    def ask(self, run: Callable[[], T]) -> Task[T]:
        """Let another thread call `run` when one is free."""
        task = Task(run, self)
        self._asked.append(task)
        self.ring()
        if self._awake < self.helpers:
            with self._lock:
                if self._awake < self.helpers:
                    self._awake += 1
                    self._threads.submit(self._help)
        return task

    def ring(self) -> None:
        """Tell all threads that wait that there is something new."""
        self._bell[0] = next(self._strokes)

    def help_until_done(self, task: Task) -> None:
        """Return when another thread has done `task`, and do what others ask meanwhile."""
        while not task.done:
            heard = self._bell[0]
            if task.done or self._did_one():
                continue
            if not changed(self._bell, heard, TURNS):
                time.sleep(NAP_S)

    def _did_one(self) -> bool:
        """Do the oldest of the tasks that nobody does yet; say whether there was one."""
        try:
            while not (task := self._asked.popleft()).taken():
                pass
        except IndexError:
            return False
        task.do()
        return True

    def _help(self) -> None:
        """Do what is asked, until nothing has been for a while."""
        while True:
            heard = self._bell[0]
            if self._did_one() or changed(self._bell, heard, TURNS):
                continue
            with self._lock:
                if not self._asked:
                    self._awake -= 1
                    return


class Task(Generic[T]):
    """What a thread has asked of others: done once, by whoever takes it first."""

    def __init__(self, run: Callable[[], T], workers: Workers) -> None:
        self.done = False
        self._run = run
        self._workers = workers
        self._free = [True]
        self._result: T | None = None
        self._error: BaseException | None = None

    def taken(self) -> bool:
        """Take the task, and say whether nobody else had."""
        try:
            return self._free.pop()
        except IndexError:
            return False

    def do(self) -> None:
        """Do the task that has been taken."""
        try:
            self._result = self._run()
        except BaseException as error:  # raised where the result is asked for
            self._error = error
        self.done = True
        self._workers.ring()

    def result(self) -> T:
        """Return what `run` returned or raise what it raised; done here where nobody has begun."""
        if self.taken():
            self.do()
        self._workers.help_until_done(self)
        if self._error is not None:
            raise self._error
        return cast(T, self._result)


def workers(threads: int) -> Workers:
    """
    Return so many threads, which all detectors of this process share and which never end.

    What a thread has allocated is kept for it after its end: a detector for each reference with
    threads of its own lets memory grow.
    """
    return _workers(threads, current_process().pid)


@cache
def _workers(threads: int, process: int | None) -> Workers:
    return Workers(threads)  # a forked process has none of its parent's threads


def take_short_turns() -> None:
    """Let threads of this process take turns more often than Python does, 5 ms: for programs."""
    sys.setswitchinterval(TURN_S)


def shared(
    executor: Workers, run: Callable[[int, int], None], rows: int, work: int, parts: int = PARTS
) -> None:
    """
    Call `run` with blocks (first, last) that cover `rows` rows once, by several threads at once.

    Which thread runs which block is left to chance, so blocks must not share anything they write.
    `work` [px] says how much there is to do, `parts` how many blocks to make.
    """
    if work < SMALL:
        run(0, rows)
        return
    blocks = [(n * rows // parts, (n + 1) * rows // parts) for n in range(parts)]

    def work_off() -> None:
        while blocks:
            try:
                block = blocks.pop()
            except IndexError:  # another thread was faster
                return
            run(*block)

    asked = [executor.ask(work_off) for _ in range(executor.helpers)]
    work_off()
    for helper in asked:
        helper.result()


def beside(executor: Workers, task: Callable[[], T]) -> Callable[[], T]:
    """
    Begin a task in another thread and return what waits for its result.

    Where no other thread has begun it by then, the caller does it.
    """
    if executor.helpers == 0:
        return task
    return executor.ask(task).result


def each(
    executor: Workers,
    run: Callable[[T], R],
    items: Sequence[T],
    work: Callable[[T], float] | None = None,
) -> list[R]:
    """
    Return `run` of each item, in their order, by several threads at once.

    Those of most `work` are begun first, the last ones where nothing is known of it: nobody shall
    wait for the one that is left.
    """
    if len(items) < 2:
        return [run(item) for item in items]
    results: list[R | None] = [None] * len(items)
    turns = sorted(range(len(items)), key=lambda n: work(items[n]) if work else n)

    def block(first: int, last: int) -> None:
        for n in turns[first:last]:
            results[n] = run(items[n])

    shared(executor, block, len(items), SMALL, max(PARTS, len(items)))
    return cast(list[R], results)
