"""The one thread that does the work: newest frame wins, a reference is never lost to a frame."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

T = TypeVar('T')
R = TypeVar('R')


@dataclass(frozen=True)
class Counts:
    """What became of the live frames: received = all the others together, once all is quiet."""

    received: int = 0
    processed: int = 0
    skipped: int = 0  # the handler had no use for it: no reference yet
    dropped: int = 0  # replaced by a newer one while the worker was busy
    failed: int = 0  # the handler raised


class Worker(Generic[T, R]):
    """
    A mailbox with one slot for a live frame and one for a reference, and the thread on it.

    Parameters
    ----------
    prepare : callable
        Run once, in the thread, before anything else.
    on_reference : callable
        Handles a reference; a waiting reference goes before a waiting frame.
    on_frame : callable
        Handles a live frame; returns False if it had no use for it.
    on_error : callable
        Told of every exception of the other three; the thread goes on.

    """

    def __init__(
        self,
        prepare: Callable[[], None],
        on_reference: Callable[[R], None],
        on_frame: Callable[[T], bool],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._prepare = prepare
        self._on_reference = on_reference
        self._on_frame = on_frame
        self._on_error = on_error
        self._wake = threading.Condition()
        self._references: deque[R] = deque(maxlen=1)
        self._frames: deque[T] = deque(maxlen=1)
        self._stopping = False
        self._counts = Counts()
        # A daemon, for the case that `stop` gives up on it: see `main`.
        self._thread = threading.Thread(target=self._run, name='rsmb_worker', daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    @property
    def stopping(self) -> bool:
        """Whether `stop` was called: what a long handler still produces is not wanted any more."""
        return self._stopping

    def submit_reference(self, reference: R) -> None:
        """Leave a reference; replaces one that waits."""
        with self._wake:
            self._references.append(reference)
            self._wake.notify()

    def submit_frame(self, frame: T) -> None:
        """Leave a live frame; replaces one that waits, which counts as dropped."""
        with self._wake:
            self._count(received=1, dropped=len(self._frames))
            self._frames.append(frame)
            self._wake.notify()

    def snapshot(self) -> Counts:
        """Return the counts at one moment."""
        with self._wake:
            return self._counts

    def stop(self, timeout_s: float) -> bool:
        """Ask the thread to end after what it is doing; return whether it did within the time."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            self._prepare()
        except Exception as error:  # thread boundary: a silent dead thread is worse
            self._on_error(error)
        while (task := self._next()) is not None:
            task()

    def _next(self) -> Callable[[], None] | None:
        """Wait for and take what is to be done next; None when stopping."""
        with self._wake:
            self._wake.wait_for(lambda: self._stopping or self._references or self._frames)
            if self._stopping:
                return None
            if self._references:
                return partial(self._handle_reference, self._references.pop())
            return partial(self._handle_frame, self._frames.pop())

    def _handle_reference(self, reference: R) -> None:
        try:
            self._on_reference(reference)
        except Exception as error:
            self._on_error(error)

    def _handle_frame(self, frame: T) -> None:
        try:
            outcome = 'processed' if self._on_frame(frame) else 'skipped'
        except Exception as error:
            self._on_error(error)
            outcome = 'failed'
        with self._wake:
            self._count(**{outcome: 1})

    def _count(self, **increments: int) -> None:
        """Add to the counts; the caller holds the lock."""
        now = self._counts
        self._counts = replace(
            now, **{name: getattr(now, name) + by for name, by in increments.items()}
        )
