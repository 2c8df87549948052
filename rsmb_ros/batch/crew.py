"""
Processes of this machine that replay, one recording each at a time.

Neither Dask nor `concurrent.futures` are used for them. Dask is an extra that a robot need not
have. A `ProcessPoolExecutor` gives up every task when one process is killed, and does not tell
which one it was; here the death of a process is a failure of its recording alone.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Protocol

from rsmb_ros.replay.workers import without_interrupt

from .tasks import Outcome, Task, carried_out

PULSE_S = 0.2  # between two looks at whether to stop
TRIES = 2  # a killed process may have been the victim of another one's hunger

Pulse = Callable[[], None]  # called again and again; what it raises ends the work


class Crew(Protocol):
    """Does tasks, several at once; a context manager that stops those in work when it is left."""

    def results(self, tasks: Sequence[Task], pulse: Pulse) -> Iterator[Outcome]:
        """Iterate over the outcomes, each as soon as it is there."""

    def __enter__(self) -> Crew: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class LocalCrew:
    """
    A `Crew` of at most `count` processes of this machine.

    They end when this process does, however it ends.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._members: list[_Member] = []

    def __enter__(self) -> LocalCrew:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for member in self._members:
            member.close()

    def results(self, tasks: Sequence[Task], pulse: Pulse) -> Iterator[Outcome]:
        """Iterate over the outcomes, each as soon as it is there."""
        waiting = deque((task, 1) for task in tasks)
        with without_interrupt():
            self._members = [_Member() for _ in range(min(self.count, len(tasks)))]
        busy: dict[Connection, tuple[_Member, Task, int]] = {}
        idle = list(self._members)
        while waiting or busy:
            while waiting and idle:
                member, (task, tries) = idle.pop(), waiting.popleft()
                member.give(task)
                busy[member.pipe] = (member, task, tries)
            pulse()
            for pipe in wait(list(busy), PULSE_S):
                assert isinstance(pipe, Connection)
                member, task, tries = busy.pop(pipe)
                outcome = member.outcome()
                if outcome is None:
                    code = member.close()
                    self._members.remove(member)
                    with without_interrupt():
                        member = _Member()
                    self._members.append(member)
                    if tries < TRIES:
                        waiting.appendleft((task, tries + 1))
                    else:
                        outcome = Outcome(task.name, _death(code))
                idle.append(member)
                if outcome is not None:
                    yield outcome


class _Member:
    """One process, seen from here."""

    def __init__(self) -> None:
        context = get_context('spawn')
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_work, args=(theirs,), name='rsmb-batch', daemon=True
        )
        self._process.start()
        theirs.close()  # so that its death is the end of the pipe

    def give(self, task: Task) -> None:
        """Have a task done; that the process is dead is met by `outcome`."""
        try:
            self.pipe.send(task)
        except OSError:
            self._process.kill()

    def outcome(self) -> Outcome | None:
        """Return the outcome of the task that was given; None if the process died over it."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            return None

    def close(self) -> int | None:
        """End the process, in the middle of a task, too; returns its exit code."""
        self.pipe.close()
        self._process.kill()  # of one that is dead already the exit code stays
        self._process.join()
        code = self._process.exitcode
        self._process.close()
        return code


def _death(code: int | None) -> str:
    return (
        f'its process died {TRIES} times, exit code {code} (-9: killed, often for want of memory); '
        'use fewer --workers'
    )


def _work(pipe: Connection) -> None:
    """Answer until the pipe ends: the life of a process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; who asks decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            pipe.send(carried_out(pipe.recv()))
        except (EOFError, OSError):
            return


def _end_with_parent() -> None:
    """Write no further to files that the next batch may be writing anew."""
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
