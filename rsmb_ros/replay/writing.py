"""Sinks fed in the thread that detects, or by one beside it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from queue import Queue
from types import TracebackType
from typing import Protocol

from .detection import Compared
from .sinks import Sink

HELD = 2  # frames that may wait to be written


class Writing(Protocol):
    """Gives frames to sinks, in their order; the sinks are not closed by it."""

    def put(self, compared: Compared) -> None:
        """Have a frame written; raises what went wrong with it, or with an earlier one."""


def writing(sinks: Sequence[Sink], beside: bool) -> AbstractContextManager[Writing]:
    """
    Return what writes `beside` the work of the caller, or as part of it: in one thread.

    When it ends all frames are written.
    """
    return WritingBeside(sinks) if beside else nullcontext(WritingInline(sinks))


class WritingInline:
    """`Writing` by whoever has a frame: all the work of a replay is that of one core."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = sinks

    def put(self, compared: Compared) -> None:
        """Write a frame."""
        for sink in self._sinks:
            sink.take(*compared)


class WritingBeside:
    """`Writing` by a thread: writing one frame and detecting the next take one time."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = sinks
        self._queue: Queue[Compared | None] = Queue(HELD)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name='rsmb-write', daemon=True)
        self._thread.start()

    def put(self, compared: Compared) -> None:
        """Have a frame written; raises what went wrong with it, or with an earlier one."""
        self._queue.put(compared)
        self._check()

    def __enter__(self) -> WritingBeside:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._queue.put(None)
        self._thread.join()
        if kind is None:
            self._check()

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while True:
            compared = self._queue.get()
            if compared is None:
                return
            if self._error is not None:
                continue  # what follows a failure would leave a gap
            try:
                for sink in self._sinks:
                    sink.take(*compared)
            except BaseException as error:  # thread boundary: raised again where it is waited for
                self._error = error
