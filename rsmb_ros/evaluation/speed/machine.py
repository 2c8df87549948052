"""What the machine can do at best, measured: the floor is made of it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

MATRIX = 768  # rows and columns; a product of 0.9 GFLOP
BLOCK = 1 << 25  # bytes a thread copies, more than its caches hold
TRIES = 40  # the best one counts: others may be using the machine


@dataclass(frozen=True)
class Rates:
    """Peak of all threads together."""

    flops: float  # float32 operations per second, a multiply-add for two
    bytes: float  # read and written per second


def measured_rates(threads: int) -> Rates:
    """Measure a matrix product and a copy on so many threads (a fraction of a second)."""
    return Rates(_product_rate(threads), _copy_rate(threads))


def _product_rate(threads: int) -> float:
    matrix = np.ones((MATRIX, MATRIX), np.float32)
    out = np.empty_like(matrix)
    with threadpool_limits(threads, 'blas'):
        seconds = [_timed(lambda: np.matmul(matrix, matrix, out)) for _ in range(TRIES)]
    return 2.0 * MATRIX**3 / min(seconds)


def _copy_rate(threads: int) -> float:
    sources = np.ones((threads, BLOCK // 4), np.float32)
    targets = np.empty_like(sources)
    with ThreadPoolExecutor(threads) as pool:

        def copy() -> None:
            list(pool.map(np.copyto, targets, sources))

        copy()  # maps the pages
        seconds = [_timed(copy) for _ in range(TRIES)]
    return 2.0 * sources.nbytes / min(seconds)


def _timed(task: Callable[[], object]) -> float:
    begin = perf_counter()
    task()
    return perf_counter() - begin
