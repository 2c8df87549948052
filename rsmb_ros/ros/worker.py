"""The one thread that does the work: newest frame wins, a reference is never lost to a frame."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, TypeVar

T = TypeVar('T')
R = TypeVar('R')

# Why a live frame was not processed, as diagnostics name it.
NEWER_FRAME = 'newer frame'  # replaced by a newer one while the worker was busy
EXCEPTION = 'exception'  # the handler raised


@dataclass(frozen=True)
class Counts:
    """What became of the live frames: received = processed + all dropped + waiting, always."""

    received: int = 0
    processed: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)  # cause -> frames
    waiting: int = 0  # in the slot or in work

    @property
    def dropped_total(self) -> int:
        """Frames dropped for any cause."""
        return sum(self.dropped.values())


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
        Handles a live frame; returns '' when it is processed, else why it was dropped.
    on_error : callable
        Told of every exception of the other three; the thread goes on.

    """

    def __init__(
        self,
        prepare: Callable[[], None],
        on_reference: Callable[[R], None],
        on_frame: Callable[[T], str],
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
        self._received = self._processed = 0
        self._dropped: Counter[str] = Counter()
        self._busy_since: float | None = None
        self._prepared = threading.Event()
        self._usable = False
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

    @property
    def usable(self) -> bool:
        """Whether the preparation is done and did not fail."""
        return self._usable

    @property
    def busy_s(self) -> float:
        """How long the present task has been in work [s]; 0 when idle."""
        since = self._busy_since
        return 0.0 if since is None else time.monotonic() - since

    def wait_prepared(self, timeout_s: float) -> bool:
        """Return whether the preparation is over, well or not, within the time."""
        return self._prepared.wait(timeout_s)

    def submit_reference(self, reference: R) -> None:
        """Leave a reference; replaces one that waits."""
        with self._wake:
            self._references.append(reference)
            self._wake.notify()

    def submit_frame(self, frame: T) -> None:
        """Leave a live frame; replaces one that waits, which counts as dropped."""
        with self._wake:
            self._received += 1
            self._dropped[NEWER_FRAME] += len(self._frames)
            self._frames.append(frame)
            self._wake.notify()

    def refuse(self, cause: str) -> None:
        """Count a live frame that came and is of no use."""
        with self._wake:
            self._received += 1
            self._dropped[cause] += 1

    def discard(self, cause: str) -> None:
        """Forget the frame that waits; a reference is never lost."""
        with self._wake:
            self._dropped[cause] += len(self._frames)
            self._frames.clear()

    def snapshot(self) -> Counts:
        """Return the counts at one moment."""
        with self._wake:
            dropped = {cause: n for cause, n in sorted(self._dropped.items()) if n}
            waiting = self._received - self._processed - sum(dropped.values())
            return Counts(self._received, self._processed, dropped, waiting)

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
            self._usable = True
        except Exception as error:  # thread boundary: a silent dead thread is worse
            self._on_error(error)
        self._prepared.set()
        while (task := self._next()) is not None:
            self._busy_since = time.monotonic()
            task()
            self._busy_since = None

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
            cause = self._on_frame(frame)
        except Exception as error:
            self._on_error(error)
            cause = EXCEPTION
        with self._wake:
            if cause:
                self._dropped[cause] += 1
            else:
                self._processed += 1
