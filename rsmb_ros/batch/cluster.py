"""Processes of other machines that replay: the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import socket
import time
import uuid
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, TypeVar

from rsmb_ros.core.errors import RsmbError

from .crew import PULSE_S, Pulse
from .tasks import Outcome, Stopped, Task, carried_out

CONNECT_S = 20.0
WORKER_S = 60.0  # for the first worker to be there
ALONE_S = 600.0  # without any later: a cluster may be given new ones
GONE = ('cancelled', 'released', 'forgotten')  # states of a task nobody waits for

T = TypeVar('T')


class ClusterCrew:
    """
    A `Crew` of the workers of a Dask cluster.

    Bags and outputs lie in folders that all machines see under one path. A worker should have one
    thread (``dask worker ADDRESS --nthreads 1``): each of its threads takes a recording. One that
    dies is replaced, and its task done again, as the scheduler is set
    (``distributed.scheduler.allowed-failures``).

    Parameters
    ----------
    address : str
        Of the scheduler: ``tcp://HOST:PORT``.

    Raises
    ------
    RsmbError
        If Dask is not installed, or there is no scheduler or no worker.

    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError as error:
            raise RsmbError(
                "--scheduler needs Dask, which is not installed: pip install 'rsmb_ros[batch]' or "
                'apt install python3-distributed; without --scheduler it is not needed'
            ) from error
        self._address = address
        try:
            self._client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, asyncio.TimeoutError) as error:
            raise RsmbError(
                f'--scheduler {address}: no Dask scheduler answers there '
                f'({type(error).__name__}: {error}); must be tcp://HOST:PORT, as `dask scheduler` '
                'says when it starts'
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=WORKER_S)
        except asyncio.TimeoutError as error:  # another one than TimeoutError before Python 3.11
            self._client.close()
            raise RsmbError(
                f'--scheduler {address}: no worker within {WORKER_S:g} s; start some with '
                f'`dask worker {address} --nthreads 1`'
            ) from error
        self._futures: list[Any] = []
        self._last_s = time.monotonic()  # when there was a worker

    def __enter__(self) -> ClusterCrew:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._client.cancel(self._futures)  # those in work notice between two frames
        self._client.close()

    def results(self, tasks: Sequence[Task], pulse: Pulse) -> Iterator[Outcome]:
        """Iterate over the outcomes, each as soon as it is there."""
        ended: SimpleQueue[tuple[Task, Any]] = SimpleQueue()
        batch = uuid.uuid4().hex
        waiting, given = deque(tasks), 0
        while waiting or given:
            pulse()
            # no more than begin at once: the scheduler blames a death on all that its worker holds
            for _ in range(min(len(waiting), self._threads() - given)):
                task = waiting.popleft()
                key = f'rsmb-{task.name}-{batch}'
                future = self._client.submit(in_worker, task, key=key, pure=False)
                self._futures.append(future)
                future.add_done_callback(lambda one, task=task: ended.put((task, one)))
                given += 1
            try:
                task, future = ended.get(timeout=PULSE_S)
            except Empty:
                continue
            given -= 1
            self._futures.remove(future)
            yield self._outcome(task, future)

    def _threads(self) -> int:
        """Return how many recordings the workers that are there now can take."""
        if self._client.status != 'running':
            raise RsmbError(
                f'--scheduler {self._address}: the scheduler is gone; what was finished is kept, '
                'the same command goes on'
            )
        count, now = sum(self._client.nthreads().values()), time.monotonic()
        if count:
            self._last_s = now
        elif now - self._last_s > ALONE_S:
            raise RsmbError(
                f'--scheduler {self._address}: no worker for {ALONE_S:g} s; what was finished is '
                f'kept: start some with `dask worker {self._address} --nthreads 1`, then the same '
                'command goes on'
            )
        return count

    def _outcome(self, task: Task, future: Any) -> Outcome:
        if future.status == 'finished':
            return future.result()
        if future.status == 'error':
            error = future.exception()
            reason = f'the worker failed: {type(error).__name__}: {error}'
        else:
            reason = f'the scheduler at {self._address} dropped it ({future.status})'
        return Outcome(task.name, ' '.join(reason.split()))


def in_worker(task: Task) -> Outcome:
    """Do a task, unless it is cancelled or its batch goes away meanwhile."""
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()

    def watch(items: Iterable[T], total: int, what: str) -> Iterator[T]:
        for item in items:
            # a thread cannot be stopped from outside
            known = worker.state.tasks.get(key)
            if known is None or known.state in GONE:
                raise Stopped(f'{task.name}: cancelled')
            yield item

    host = socket.gethostname()
    folder = Path(task.options['output']).parent
    if not folder.is_dir():
        return Outcome(
            task.name,
            f'{folder}: is not there on {host}; bags and outputs must lie in folders that all '
            'workers see under one path',
        )
    outcome = carried_out(task, watch)
    return replace(outcome, reason=f'{outcome.reason} (on {host})') if outcome.reason else outcome
