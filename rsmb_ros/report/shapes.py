"""Shapes of an SVG as text: no plotting library, and numbers no longer than they need to be."""

from __future__ import annotations

import math

import numpy as np

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def ticks(low: float, high: float, wanted: int = 3) -> list[float]:
    """Return round numbers from `low` to `high`, about `wanted` of them, at least two."""
    raw = max(high - low, 1e-12) / max(wanted, 1)
    decade = 10.0 ** math.floor(math.log10(raw))
    step = next(decade * one for one in _STEPS if decade * one >= raw * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    if last <= first and wanted < 20:  # one number is no scale
        return ticks(low, high, 2 * wanted)
    return [round(n * step, 10) + 0.0 for n in range(first, last + 1)]


def line(x: np.ndarray, y: np.ndarray) -> str:
    """Return a path through points, interrupted where one is not finite."""
    parts = []
    pen = 'M'
    for a, b in _short(np.stack([x, y], axis=1)):
        if math.isfinite(a + b):
            parts.append(f'{pen}{a:g} {b:g}')
            pen = 'L'
        else:
            pen = 'M'
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
    shown = _short(np.stack([left, heights], axis=1))
    return ''.join(
        f'M{x:g} {base:g}v{-height:g}h{width:g}v{height:g}z' for x, height in shown if height > 0
    )


def _short(values: np.ndarray) -> list:
    """Return numbers with one digit after the point, as Python prints them fast."""
    return (np.round(values, 1) + 0.0).tolist()
