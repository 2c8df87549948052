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

from .worker import Counts

T = TypeVar('T')

WINDOW_S = 5.0  # "now", for rates, latency and the verdict

# Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = range(4)


@dataclass(frozen=True)
class Report:
    """One verdict and the numbers behind it."""

    level: int  # OK, WARN, ERROR or STALE
    message: str
    values: dict[str, str]


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

    def malformed(self, cause: str) -> None:
        """Note a message that could not be read."""
        with self._lock:
            self._malformed_total[cause] += 1
            self._malformed.append((self._clock(), cause))

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
            From its stamp to now [s]; None for a frame without a stamp.

        """
        now = self._clock()
        with self._lock:
            self._last = result
            self._outputs.append((now, turnaround_s))
            if latency_s is not None:
                self._latencies.append((now, latency_s))

    def report(self, counts: Counts, worker_alive: bool) -> Report:
        """Return the state of the last `WINDOW_S` seconds and the totals."""
        with self._lock:
            level, message = self._verdict(worker_alive)
            return Report(level, message, self._values(counts, worker_alive))

    def _verdict(self, worker_alive: bool) -> tuple[int, str]:
        """Return the gravest trouble; a cause goes before what follows from it."""
        now = self._clock()
        errors = self._errors.values_at(now)
        malformed = self._malformed.values_at(now)
        if not worker_alive:
            return ERROR, 'the worker thread has ended: restart the node'
        if errors:
            return ERROR, f'processing failed: {errors[-1]}'
        if malformed:
            causes = ', '.join(sorted(set(malformed)))
            return WARN, f'{len(malformed)} malformed messages in {WINDOW_S:g} s: {causes}'
        if self._last_frame_at is None:
            return STALE, 'no live frame yet'
        if not self._frames.values_at(now):
            return STALE, f'no live frame for {now - self._last_frame_at:.0f} s'
        if self._reference_at is None:
            return WARN, 'no reference yet'
        if self._last is None or not self._outputs.values_at(now):
            return WARN, f'no result in the last {WINDOW_S:g} s'
        if self._last.status != REGISTERED:
            return WARN, f'{self._last.status}: {self._last.reason}'
        return OK, self._last.status

    def _values(self, counts: Counts, worker_alive: bool) -> dict[str, str]:
        now = self._clock()
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
            'frames received': str(counts.received),
            'frames processed': str(counts.processed),
            'frames dropped': str(counts.dropped),
            'frames failed': str(counts.failed),
            'frames without reference': str(counts.skipped),
            'malformed messages': str(self._malformed_total.total()),
            **{f'malformed: {cause}': str(n) for cause, n in sorted(self._malformed_total.items())},
            'status': self._last.status if self._last else 'none yet',
            'reason': self._last.reason if self._last else '',
            'exposure [rows]': _exposure(self._last),
            'reference': 'absent' if self._reference_at is None else 'present',
            'references received': str(self._references),
            'reference age [s]': (
                '' if self._reference_at is None else f'{now - self._reference_at:.1f}'
            ),
            'worker alive': str(worker_alive).lower(),
        }


def _percentile_ms(seconds: list[float], percent: int) -> str:
    """Return the nearest-rank percentile in ms; empty without values."""
    if not seconds:
        return ''
    rank = math.ceil(percent / 100 * len(seconds)) - 1
    return f'{1e3 * sorted(seconds)[rank]:.1f}'


def _exposure(result: Result | None) -> str:
    return f'{result.exposure_rows:.1f}' if result and math.isfinite(result.exposure_rows) else ''
