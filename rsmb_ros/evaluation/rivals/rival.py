"""A registrar and a decision make a method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import cv2
import numpy as np

from rsmb_ros.core.photometric import luma

from ..methods import NotRegistered, Outcome, Registrar, Registration

Decision = Callable[[np.ndarray, Registration], np.ndarray]


@dataclass(frozen=True)
class Attempt:
    """What a registrar makes of a pair; rivals with the same registrar can share it."""

    registration: Registration | None  # None when not registered
    reason: str  # why not registered, '' otherwise
    seconds: float  # wall clock


@dataclass(frozen=True)
class Rival:
    """
    A method that others use.

    ``rival(reference, live, focal_px)`` does all; a benchmark that has a default and its tuned twin
    calls `register` once and `judge` for both: their `registrar` is the same.
    """

    name: str
    source: str  # where it comes from and with which parameters, one line
    registrar: Registrar
    decide: Decision  # live (M, N) float32 and its registration -> changed (M, N) bool

    def __call__(self, reference: np.ndarray, live: np.ndarray, focal_px: float | None) -> Outcome:
        """Compare a live frame with the reference, both uint8, grey or BGR; never raises."""
        return self.judge(live, self.register(reference, live, focal_px))

    def register(self, reference: np.ndarray, live: np.ndarray, focal_px: float | None) -> Attempt:
        """Register a live frame, both uint8, grey or BGR; never raises."""
        begin = perf_counter()
        registration, reason = None, ''
        try:
            registration = self.registrar.register(luma(reference), luma(live), focal_px)
        except NotRegistered as why:
            reason = str(why)
        except (cv2.error, np.linalg.LinAlgError) as error:  # degenerate data inside a library
            reason = f'{type(error).__name__}: {getattr(error, "err", error)}'
        return Attempt(registration, reason, perf_counter() - begin)

    def judge(self, live: np.ndarray, attempt: Attempt) -> Outcome:
        """Find the changes in a live frame, uint8, grey or BGR, that `register` has tried."""
        begin = perf_counter()
        registration = attempt.registration
        nothing = np.zeros(live.shape[:2], bool)
        if registration is None:
            return Outcome(False, attempt.reason, nothing, nothing, None, attempt.seconds)
        change = self.decide(luma(live), registration)
        seconds = attempt.seconds + perf_counter() - begin
        return Outcome(True, '', change, registration.inside, registration, seconds)
