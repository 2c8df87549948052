"""What is measured: one interface for ours and for every rival."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Registration:
    """Where a live frame of M x N px lies in the reference."""

    registered: np.ndarray  # (M, N) float32, reference as the live camera saw it [grey levels]
    inside: np.ndarray  # (M, N) bool, the pixel's place lies in the reference
    places: np.ndarray  # (M, N, 2) float32, x, y of each live pixel in the reference [px]


class NotRegistered(Exception):
    """A registrar gives up; the text says why."""


class Registrar(Protocol):
    """Finds where a live frame lies in the reference."""

    @property
    def name(self) -> str:
        """Short, for tables."""
        ...

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """
        Register a frame.

        Parameters
        ----------
        reference, live : ndarray of shape (M', N') and (M, N), float32
            Grey levels 0..255.
        focal_px : float or None
            Focal length of both [px]; None: unknown.

        Raises
        ------
        NotRegistered
            If it finds no registration.

        """


@dataclass(frozen=True)
class Outcome:
    """What a method says of one case."""

    registered: bool
    reason: str  # why not registered, '' otherwise
    change: np.ndarray  # (M, N) bool
    valid: np.ndarray  # (M, N) bool, judged
    registration: Registration | None  # None when not registered
    seconds: float  # wall clock
    exposure_rows: float = float('nan')  # estimated [rows]; NaN where a method has none
    depths: tuple[tuple[np.ndarray, float], ...] = ()  # static objects: mask (M, N), relative depth


class Method(Protocol):
    """A registration and a decision what has changed."""

    @property
    def name(self) -> str:
        """Short, for tables."""
        ...

    @property
    def source(self) -> str:
        """Where it comes from and with which parameters, one line."""
        ...

    def __call__(self, reference: np.ndarray, live: np.ndarray, focal_px: float | None) -> Outcome:
        """Compare a live frame with the reference, both uint8, grey or BGR; never raises."""
