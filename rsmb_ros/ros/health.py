"""What `/diagnostics` tells: rates, latency, losses and one verdict, over the last seconds."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from rsmb_ros.core.types import REGISTERED, Result
from rsmb_ros.messages.quality import known_number, quality

from .worker import Counts

T = TypeVar('T')

WINDOW_S = 5.0  # "now", for rates, latency and the verdict

# Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = range(4)

ACTIVE = 'active'  # the lifecycle state in which frames are expected


@dataclass(frozen=True)
class Report:
    """One verdict and the numbers behind it."""

    level: int  # OK, WARN, ERROR or STALE
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class NodeState:
    """What the node is about at one moment."""

    lifecycle: str  # 'unconfigured', 'configuring', 'inactive', 'active', 'finalized', ...
    worker: str  # 'none', 'compiling', 'idle', 'busy' or 'ended'
    busy_s: float = 0.0  # how long the present task has been in work [s]
    deadline_s: float = math.inf  # for one task, worker.deadline_s [s]
    paused: bool = False  # by ~/enable


class _Recent(deque[tuple[float, T]]):
    """Values of the last `WINDOW_S` seconds with their times."""

    def values_at(self, now: float) -> list[T]:
        """Forget what is older than the window and return the rest."""
        while self and self[0][0] < now - WINDOW_S:
            self.popleft()
        return [value for _, value in self]


class Health:
    """Collects events from every thread; `report` may be called from any."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._started = clock()
        self._lock = threading.Lock()
        self._malformed_total: Counter[str] = Counter()
        self._malformed: _Recent[str] = _Recent()
        self._stamps_total: Counter[str] = Counter()
        self._stamps: _Recent[str] = _Recent()
        self._slow_total = 0
        self._slow: _Recent[float] = _Recent()
        self._errors: _Recent[str] = _Recent()
        self._frames: _Recent[None] = _Recent()
        self._outputs: _Recent[float] = _Recent()
        self._latencies: _Recent[float] = _Recent()
        self._last_frame_at: float | None = None
        self._references = 0
        self._reference_at: float | None = None
        self._last: Result | None = None

    def frame_received(self) -> None:
        """Note a live frame that could be read."""
        with self._lock:
            self._last_frame_at = self._clock()
            self._frames.append((self._last_frame_at, None))

    def reference_received(self) -> None:
        """Note a reference that differs from the one before."""
        with self._lock:
            self._references += 1
            self._reference_at = self._clock()

    def reference_lost(self) -> None:
        """Note that there is no reference any more."""
        with self._lock:
            self._reference_at = None

    def malformed(self, cause: str) -> None:
        """Note a message that could not be read."""
        with self._lock:
            self._malformed_total[cause] += 1
            self._malformed.append((self._clock(), cause))

    def odd_stamp(self, kind: str) -> None:
        """Note a stamp that time does not explain: 'repeated', 'backwards', ..."""
        with self._lock:
            self._stamps_total[kind] += 1
            self._stamps.append((self._clock(), kind))

    def slow(self, took_s: float) -> None:
        """Note a frame that took longer than its deadline."""
        with self._lock:
            self._slow_total += 1
            self._slow.append((self._clock(), took_s))

    def failed(self, error: Exception) -> None:
        """Note an exception in the worker."""
        with self._lock:
            self._errors.append((self._clock(), f'{type(error).__name__}: {error}'))

    def published(self, result: Result, turnaround_s: float, latency_s: float | None) -> None:
        """
        Note a processed frame.

        Parameters
        ----------
        result : Result
        turnaround_s : float
            From its arrival to now [s].
        latency_s : float, optional
            From its stamp to now [s]; None for a frame without a stamp. Below 0 it says something
            of the clocks and nothing of us, and is left out.

        """
        now = self._clock()
        with self._lock:
            self._last = result
            self._outputs.append((now, turnaround_s))
            if latency_s is not None and latency_s >= 0:
                self._latencies.append((now, latency_s))

    def report(self, counts: Counts, state: NodeState) -> Report:
        """Return the state of the last `WINDOW_S` seconds and the totals."""
        with self._lock:
            now = self._clock()
            level, message = self._verdict(now, state)
            values = {
                **self._rates(now),
                **self._totals(counts),
                **self._registration(now),
                'lifecycle state': state.lifecycle,
                'paused': str(state.paused).lower(),
                'worker': state.worker,
                'worker busy [s]': f'{state.busy_s:.2f}',
                'worker alive': str(state.worker not in ('none', 'ended')).lower(),
            }
        return Report(level, message, values)

    def _verdict(self, now: float, state: NodeState) -> tuple[int, str]:
        """Return the gravest trouble; a cause goes before what follows from it."""
        if state.worker == 'ended':
            return ERROR, 'the worker thread has ended: restart the node'
        if state.busy_s > state.deadline_s:
            return ERROR, (
                f'in work for {state.busy_s:.1f} s, worker.deadline_s = {state.deadline_s:g}'
            )
        if errors := self._errors.values_at(now):
            return ERROR, f'processing failed: {errors[-1]}'
        if state.lifecycle != ACTIVE:
            return WARN, f'not active: {state.lifecycle}'
        if malformed := self._malformed.values_at(now):
            causes = ', '.join(sorted(set(malformed)))
            return WARN, f'{len(malformed)} malformed messages in {WINDOW_S:g} s: {causes}'
        if state.paused:
            return WARN, 'paused by ~/enable'
        return self._verdict_on_frames(now)

    def _verdict_on_frames(self, now: float) -> tuple[int, str]:
        """Return what frames and results, or their lack, say."""
        if self._last_frame_at is None:
            return STALE, 'no live frame yet'
        if not self._frames.values_at(now):
            return STALE, f'no live frame for {now - self._last_frame_at:.0f} s'
        if self._reference_at is None:
            return WARN, 'no reference yet'
        if slow := self._slow.values_at(now):
            return WARN, f'{len(slow)} frames over worker.deadline_s, up to {max(slow):.1f} s'
        if stamps := self._stamps.values_at(now):
            return WARN, f'{len(stamps)} odd stamps: {", ".join(sorted(set(stamps)))}'
        if self._last is None or not self._outputs.values_at(now):
            return WARN, f'no result in the last {WINDOW_S:g} s'
        if self._last.status != REGISTERED:
            return WARN, f'{self._last.status}: {self._last.reason}'
        return OK, self._last.status

    def _rates(self, now: float) -> dict[str, str]:
        span = max(min(WINDOW_S, now - self._started), 1e-3)
        latencies = self._latencies.values_at(now)
        turnarounds = self._outputs.values_at(now)
        return {
            'input rate [Hz]': f'{len(self._frames.values_at(now)) / span:.2f}',
            'output rate [Hz]': f'{len(turnarounds) / span:.2f}',
            'latency stamp to published p50 [ms]': _percentile_ms(latencies, 50),
            'latency stamp to published p95 [ms]': _percentile_ms(latencies, 95),
            'latency arrival to published p50 [ms]': _percentile_ms(turnarounds, 50),
            'latency arrival to published p95 [ms]': _percentile_ms(turnarounds, 95),
        }

    def _totals(self, counts: Counts) -> dict[str, str]:
        return {
            'frames received': str(counts.received),
            'frames processed': str(counts.processed),
            'frames dropped': str(counts.dropped_total),
            'frames waiting': str(counts.waiting),
            **{f'dropped: {cause}': str(n) for cause, n in counts.dropped.items()},
            'frames over deadline': str(self._slow_total),
            'malformed messages': str(self._malformed_total.total()),
            **{f'malformed: {cause}': str(n) for cause, n in sorted(self._malformed_total.items())},
            **{f'stamps {kind}': str(n) for kind, n in sorted(self._stamps_total.items())},
        }

    def _registration(self, now: float) -> dict[str, str]:
        last = self._last
        age = '' if self._reference_at is None else f'{now - self._reference_at:.1f}'
        return {
            'status': last.status if last else 'none yet',
            'reason': last.reason if last else '',
            **quality(last),
            'exposure [rows]': known_number(last.exposure_rows, 1) if last else '',
            'reference': 'present' if age else 'absent',
            'references received': str(self._references),
            'reference age [s]': age,
        }


def _percentile_ms(seconds: list[float], percent: int) -> str:
    """Return the nearest-rank percentile in ms; empty without values."""
    if not seconds:
        return ''
    rank = math.ceil(percent / 100 * len(seconds)) - 1
    return f'{1e3 * sorted(seconds)[rank]:.1f}'
