"""Numbers that vary from frame to frame, in few words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ..summary import median, percentile
from ..tables import ABSENT


@dataclass(frozen=True)
class Spread:
    """Median and quartiles; NaN where there is nothing to tell."""

    q1: float
    median: float
    q3: float

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread:
        """Return the spread of those that are not NaN."""
        known = list(values)
        return cls(percentile(known, 25), median(known), percentile(known, 75))

    def cells(self, spec: str) -> tuple[str, str]:
        """Return median and quartiles as text."""
        return number(self.median, spec), quartiles(self, spec)


def number(value: float, spec: str) -> str:
    """Return a number as text, `ABSENT` for NaN."""
    return ABSENT if math.isnan(value) else format(value, spec)


def quartiles(spread: Spread, spec: str) -> str:
    """Return both quartiles as text, `ABSENT` for NaN."""
    ends = number(spread.q1, spec), number(spread.q3, spec)
    return ABSENT if ABSENT in ends else ' - '.join(ends)


def size_name(shape: tuple[int, int]) -> str:
    """Return rows and columns [px] as COLSxROWS."""
    return f'{shape[1]}x{shape[0]}'
