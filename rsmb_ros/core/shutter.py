"""Row timing of the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ShutterTiming:
    """
    Row timing; the n-th row read is lit during [n, n + exposure_rows], in line delays (Eq. 1).

    The four regimes are settings of it: a global shutter has ``rolling=False`` (every row is lit
    at once), a sharp image an exposure of 0.
    """

    exposure_rows: float  # t_e / t_d [rows]
    rolling: bool = True
    bottom_up: bool = False  # the last row is read first

    @classmethod
    def from_seconds(cls, t_e: float, t_d: float, *, bottom_up: bool = False) -> ShutterTiming:
        """Return the timing of exposure `t_e` and line delay `t_d` > 0, both in seconds."""
        return cls(t_e / t_d, bottom_up=bottom_up)

    def middles(self, rows: int) -> np.ndarray:
        """Middle of each row's exposure (rows,), 0 for the first row read [rows]."""
        if not self.rolling:
            return np.full(rows, (rows - 1) / 2.0)
        times = np.arange(rows, dtype=np.float64)
        return times[::-1].copy() if self.bottom_up else times
