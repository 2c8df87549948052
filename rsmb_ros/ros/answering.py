"""From a frame to what is published for it; runs in the worker's thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from rsmb_ros.core.errors import FrameError
from rsmb_ros.core.types import Result

from .health import Health
from .logs import LOG_EVERY_S, Log
from .processing import Processing
from .reception import MALFORMED, Frame
from .references import References

# Causes of dropped frames, beside those of worker, reception and outputs.
NO_REFERENCE = 'no reference'
REPEATED_STAMP = 'repeated stamp'
STOPPING = 'node stops'


class Publishing(Protocol):
    """What of `Outputs` is used."""

    def publish(self, result: Result, image: np.ndarray, header: Any) -> str:
        """Publish; return '' or why nothing was published."""


class Answering:
    """
    What the worker does.

    Parameters
    ----------
    processing : Processing
    outputs : Outputs
    health : Health
    now_ns : callable
        Returns the node's time [ns].
    unwanted : callable
        Returns whether the node is about to end, and publishes nothing any more.
    log : Log

    """

    def __init__(
        self,
        processing: Processing,
        outputs: Publishing,
        health: Health,
        now_ns: Callable[[], int],
        unwanted: Callable[[], bool],
        log: Log,
    ) -> None:
        self._processing = processing
        self._outputs = outputs
        self._health = health
        self._now_ns = now_ns
        self._unwanted = unwanted
        self._log = log
        self._answered_ns = 0  # stamp of the last frame that was published

    def prepare(self) -> None:
        """Compile the kernels."""
        start = time.monotonic()
        self._processing.prepare()
        self._log.info(f'kernels compiled in {time.monotonic() - start:.1f} s')

    def reference(self, references: References) -> None:
        """Take a reference; one that cannot be used leaves none."""
        pair = references.take()
        if pair is None:
            return
        try:
            self._processing.set_reference(pair.image, pair.depth)
        except FrameError as error:
            self._health.malformed('reference')
            self._health.reference_lost()
            self._log.warning(f'reference refused, there is none now: {error}')

    def frame(self, frame: Frame) -> str:
        """Answer one frame; return '' or why it was dropped."""
        if frame.stamp_ns and frame.stamp_ns == self._answered_ns:
            self._health.odd_stamp('repeated')
            return REPEATED_STAMP
        begin_s = time.monotonic()
        try:
            image = frame.read()
            result = self._processing.detect(image, frame.stamp_ns or None)
        except FrameError as error:
            self._health.malformed(getattr(error, 'cause', 'size'))
            self._log.warning(f'image skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
            return MALFORMED
        if result is None:
            return NO_REFERENCE
        self._check_deadline(time.monotonic() - begin_s)
        if self._unwanted():
            return STOPPING
        if cause := self._outputs.publish(result, image, frame.header):
            return cause
        self._answered_ns = frame.stamp_ns
        latency_ns = self._now_ns() - frame.stamp_ns
        self._health.published(
            result,
            turnaround_s=time.monotonic() - frame.arrived_s,
            latency_s=latency_ns * 1e-9 if frame.stamp_ns else None,
        )
        return ''

    def error(self, error: Exception) -> None:
        """Report an exception; the worker goes on."""
        if not self._unwanted():
            self._health.failed(error)
            self._log.error(
                f'processing failed: {type(error).__name__}: {error}',
                throttle_duration_sec=LOG_EVERY_S,
            )

    def _check_deadline(self, took_s: float) -> None:
        deadline_s = self._processing.config.worker.deadline_s
        if took_s > deadline_s:
            self._health.slow(took_s)
            self._log.warning(
                f'a frame took {took_s:.2f} s, worker.deadline_s = {deadline_s:g}',
                throttle_duration_sec=LOG_EVERY_S,
            )
