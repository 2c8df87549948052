"""Processes that detect; each has a detector of its own and keeps it while the reference lasts."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from queue import SimpleQueue
from types import TracebackType

import cv2
import numpy as np

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.config import WorkerConfig
from rsmb_ros.core.errors import RsmbError
from rsmb_ros.core.outcome import Outcome
from rsmb_ros.core.settled import settled

from .pairs import Reference

DEADLINE_S = 5.0  # for a worker to end by itself


class WorkerPool:
    """
    A fixed number of processes, each asked by a thread of its own; a context manager.

    Parameters
    ----------
    count : int
    camera : Camera, optional
    config : Config
        `worker.threads` that is not the default is what each worker gets, else they share the
        cores. Results do not depend on it.
    depth : ndarray, optional
        See `Detector`.

    """

    def __init__(
        self, count: int, camera: Camera | None, config: Config, depth: np.ndarray | None
    ) -> None:
        self.count = count
        config = config.replaced({'worker.threads': threads_each(count, config)})
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        with without_interrupt():
            self._workers = [_Worker(n, (camera, config, depth)) for n in range(count)]
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(count, 'rsmb-ask')

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self._workers:
            if kind is not None:
                worker.stop()  # whoever waits for it is let go
        self._threads.shutdown(cancel_futures=True)
        for worker in self._workers:
            worker.close()

    def submit(self, reference: Reference, live: np.ndarray) -> Future[Outcome]:
        """
        Detect a frame in whichever worker is idle first.

        The future holds what `Detector.detect_alone` returns or raises, or an `RsmbError` if the
        process died.
        """
        return self._threads.submit(self._ask, reference, live)

    def _ask(self, reference: Reference, live: np.ndarray) -> Outcome:
        worker = self._idle.get()
        try:
            return worker.ask(reference, live)
        finally:
            self._idle.put(worker)


class _Worker:
    """One process, seen from here."""

    def __init__(
        self, number: int, settings: tuple[Camera | None, Config, np.ndarray | None]
    ) -> None:
        self.number = number
        context = get_context('spawn')
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_work, args=(theirs, *settings), name=f'rsmb-worker-{number}', daemon=True
        )
        self._process.start()
        theirs.close()  # so that its death is the end of the pipe
        self._known = -1  # number of the reference it has

    def ask(self, reference: Reference, live: np.ndarray) -> Outcome:
        """Return the outcome of one frame; the reference is sent only when it is another one."""
        new = reference.image if reference.number != self._known else None
        try:
            self._pipe.send((new, live))
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            self._process.join(DEADLINE_S)
            raise RsmbError(
                f'worker {self.number} of the replay died, exit code {self._process.exitcode} '
                '(-9: killed, often for want of memory: use fewer --workers; 1: a script must '
                "call replay below if __name__ == '__main__')"
            ) from error
        self._known = reference.number
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def stop(self) -> None:
        """End the process now."""
        self._process.terminate()

    def close(self) -> None:
        """Let the process end; it does when the pipe does."""
        self._pipe.close()
        self._process.join(DEADLINE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()


def threads_each(count: int, config: Config, cores: int | None = None) -> int:
    """Return the threads of each of `count` workers that share `cores`; None: all there are."""
    if config.worker.threads != WorkerConfig().threads:
        return config.worker.threads
    return max(1, (cores or os.cpu_count() or 1) // count)


def _work(
    pipe: Connection, camera: Camera | None, config: Config, depth: np.ndarray | None
) -> None:
    """Answer until the pipe ends: the life of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; who asks decides
    cv2.setNumThreads(config.worker.threads)
    detector: Detector | None = None
    while True:
        try:
            reference, live = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            if reference is not None:
                detector = Detector(reference, camera, config, depth)
            assert detector is not None
            answer: Outcome | Exception = _alone(detector, live)
        except Exception as error:  # process boundary: whoever asks gets it
            answer = error
        try:
            pipe.send(answer)
        except OSError:
            return


def _alone(detector: Detector, live: np.ndarray) -> Outcome:
    outcome = detector.detect_alone(live)
    result = settled(outcome.result)
    if detector.config.change.persistence_frames > 1:
        return replace(outcome, result=result)
    return Outcome(result)  # nothing will be remembered: spare the way


@contextmanager
def without_interrupt() -> Iterator[None]:
    """Start processes that never mind Ctrl-C, not even before their first line."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
