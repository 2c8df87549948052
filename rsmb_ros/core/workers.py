"""Threads that share the work on one frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import cache
from multiprocessing import current_process
from typing import TypeVar, cast

PARTS = 8  # blocks that work is cut into: enough that nobody waits long for the last one
SMALL = 1 << 14  # px; handing out less than that takes longer than doing it

T = TypeVar('T')
R = TypeVar('R')


class Workers(ThreadPoolExecutor):
    """So many `threads`, the caller among them."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads, 'rsmb')
        self.helpers = threads - 1


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


def shared(
    executor: Executor, run: Callable[[int, int], None], rows: int, work: int, parts: int = PARTS
) -> None:
    """
    Call `run` with blocks (first, last) that cover `rows` rows once, by several threads at once.

    The caller takes blocks, too, and asks as few threads as there are: each that is woken costs
    more than a block. Which thread runs which block is left to chance, so blocks must not share
    anything they write. `work` [px] says how much there is to do, `parts` how many blocks to make.
    """
    blocks = [(n * rows // parts, (n + 1) * rows // parts) for n in range(parts)]
    if work < SMALL:
        run(0, rows)
        return

    def work_off() -> None:
        while blocks:
            try:
                block = blocks.pop()
            except IndexError:  # another thread was faster
                return
            run(*block)

    helpers = getattr(executor, 'helpers', 1)
    asked = [executor.submit(work_off) for _ in range(helpers)]
    work_off()
    for helper in asked:
        if not helper.cancel():  # one that has not begun by now is not needed
            helper.result()


def beside(executor: Executor, task: Callable[[], T]) -> Callable[[], T]:
    """
    Begin a task in another thread and return what waits for its result.

    Where no other thread has begun it by then, the caller does it.
    """
    if getattr(executor, 'helpers', 1) == 0:
        return task
    begun = executor.submit(task)
    return lambda: task() if begun.cancel() else begun.result()


def each(executor: Executor, run: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """Return `run` of each item, in their order, by several threads at once."""
    if len(items) < 2:
        return [run(item) for item in items]
    results: list[R | None] = [None] * len(items)

    def block(first: int, last: int) -> None:
        for n in range(first, last):
            results[n] = run(items[n])

    shared(executor, block, len(items), SMALL)
    return cast(list[R], results)
