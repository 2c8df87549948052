"""Shapes of an SVG as text: no plotting library, and numbers no longer than they need to be."""

from __future__ import annotations

import math

import numpy as np

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def ticks(low: float, high: float, wanted: int = 3) -> list[float]:
    """Return round numbers from `low` to `high`, about `wanted` of them."""
    raw = max(high - low, 1e-12) / max(wanted, 1)
    decade = 10.0 ** math.floor(math.log10(raw))
    step = next(decade * one for one in _STEPS if decade * one >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(n * step, 10) + 0.0 for n in range(first, last + 1)]


def line(x: np.ndarray, y: np.ndarray) -> str:
    """Return a path through points, interrupted where one is not finite."""
    parts = []
    pen = 'M'
    for a, b in zip(x, y, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            pen = 'M'
            continue
        parts.append(f'{pen}{_short(a)} {_short(b)}')
        pen = 'L'
    return ''.join(parts)


def band(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    """Return the closed path between two curves; points that are not finite are left out."""
    known = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
    if np.count_nonzero(known) < 2:
        return ''
    there = line(x[known], low[known])
    return there + 'L' + line(x[known][::-1], high[known][::-1])[1:] + 'Z'


def bars(left: np.ndarray, heights: np.ndarray, base: float, width: float) -> str:
    """Return upright bars that stand on `base` (y grows downwards); none where the height is 0."""
    return ''.join(
        f'M{_short(x)} {_short(base)}v{_short(-height)}h{_short(width)}v{_short(height)}z'
        for x, height in zip(left, heights, strict=True)
        if height > 0
    )


def _short(value: float) -> str:
    return f'{round(value, 1) + 0.0:g}'
