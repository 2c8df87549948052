"""One recording of a batch, as it is sent to a worker, replayed there, and answered."""

from __future__ import annotations

import logging
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import cv2

import rsmb_ros
from rsmb_ros.bags.writing import part_of
from rsmb_ros.core.errors import RsmbError
from rsmb_ros.replay.job import ReplayJob, Watch, replay, unwatched
from rsmb_ros.replay.stored import CannotGoOn
from rsmb_ros.replay.summary import Summary

MOST_WARNINGS = 5  # of one recording that are kept

_log = logging.getLogger(__name__)


class Stopped(Exception):
    """Raised by a watch: nobody waits for this replay any more."""


@dataclass(frozen=True)
class Task:
    """One replay that is to be done."""

    name: str
    # Of `ReplayJob`: made where it is done, as it looks at files. `resume`: go on with an output
    # that is whole, too; with an unfinished one it always does.
    options: Mapping[str, Any]
    version: str  # of rsmb_ros: another one might find something else


@dataclass(frozen=True)
class Counts:
    """What came out of a replay."""

    frames: int
    skipped: int  # frames that could not be read
    lost: int  # messages in damaged parts of the file, as far as that is known
    registered: int
    changes: int
    resumed: int = 0  # of the frames, those that were there from before


@dataclass(frozen=True)
class Outcome:
    """How a task ended."""

    name: str
    reason: str = ''  # why it failed, one line; empty: it did not
    counts: Counts | None = None  # None: it failed
    seconds: float = 0.0  # wall-clock
    warnings: tuple[str, ...] = ()


def carried_out(task: Task, watch: Watch = unwatched) -> Outcome:
    """
    Replay one recording; whatever is wrong with it is an outcome.

    Raises
    ------
    Stopped
        If the watch does.

    """
    start = time.monotonic()
    with _warnings() as warnings:
        counts, reason = None, ''
        try:
            counts = _counts(_replayed(task, watch))
        except Stopped:
            raise
        except RsmbError as error:
            reason = str(error)
        except OSError as error:  # a full disk
            reason = f'{error.filename or task.options["output"]}: {error.strerror or error}'
        except Exception as error:  # a fault of ours must not cost the other recordings
            last = traceback.extract_tb(error.__traceback__)[-1]
            reason = f'{type(error).__name__}: {error} ({last.filename}, line {last.lineno})'
    return Outcome(
        task.name,
        reason=' '.join(reason.split()),
        counts=counts,
        seconds=round(time.monotonic() - start, 3),
        warnings=tuple(warnings[:MOST_WARNINGS]),
    )


def _replayed(task: Task, watch: Watch) -> Summary:
    if task.version != rsmb_ros.__version__:
        raise RsmbError(
            f'the worker has rsmb_ros {rsmb_ros.__version__}, the batch {task.version}; '
            'install the same version there'
        )
    part = part_of(task.options['output'])
    if task.options.get('resume') or part.exists():
        try:
            return _run({**task.options, 'resume': True}, watch)
        except CannotGoOn as error:
            _log.warning('%s; all frames are replayed', error)
    part.unlink(missing_ok=True)
    return _run({**task.options, 'resume': False}, watch)


def _run(options: Mapping[str, Any], watch: Watch) -> Summary:
    job = ReplayJob(**options)
    cv2.setNumThreads(job.at_work().worker.threads)
    return replay(job, watch)


def _counts(summary: Summary) -> Counts:
    return Counts(
        frames=summary.frames,
        skipped=summary.skipped,
        lost=summary.lost,
        registered=summary.registered,
        changes=summary.changes,
        resumed=summary.resumed,
    )


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect what is logged by this thread: a process may replay several at once."""
    heard = _Heard()
    logger = logging.getLogger('rsmb_ros')
    logger.addHandler(heard)
    try:
        yield heard.texts
    finally:
        logger.removeHandler(heard)


class _Heard(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._thread = threading.get_ident()
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread:
            self.texts.append(' '.join(record.getMessage().split()))
