"""How often each nuisance of a camera occurs in a suite, and how strong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from rsmb_ros.core.synthesis import Nuisances


class Range(NamedTuple):
    """A nuisance occurs in `share` of the cases, uniform from `low` to `high`."""

    share: float
    low: float
    high: float


NONE: Mapping[str, Range] = {}
LINEAR = {'gamma': Range(1.0, 1.0, 1.0)}  # intensities are added as they are
ALL: Mapping[str, Range] = {
    'gain': Range(1.0, 0.8, 1.25),
    'bias': Range(0.3, -1.5, 3.0),
    'vignetting': Range(0.7, 0.05, 0.25),
    'overexposure': Range(0.25, 1.1, 1.6),
    'defocus_px': Range(0.5, 0.3, 0.8),
    'noise_electrons': Range(1.0, 3000, 15000),
    'read_noise': Range(1.0, 0.1, 0.6),
    'mosaic': Range(0.5, 1, 1),
    'gamma': Range(1.0, 2.0, 2.4),
    'sharpening': Range(0.3, 0.2, 0.8),
    'jpeg_quality': Range(1.0, 82, 95),
    'distortion': Range(0.5, -0.003, 0.003),
}
# Light is what the suite `light` is about.
STRONG_LIGHT = {
    **ALL,
    'gain': Range(1.0, 0.55, 1.8),
    'bias': Range(0.7, -3.0, 8.0),
    'vignetting': Range(1.0, 0.1, 0.4),
    'overexposure': Range(0.5, 1.2, 2.0),
}
# Another camera, or other settings, than the reference's.
OTHER_TONES = {**ALL, 'contrast': Range(0.8, -0.6, 0.8), 'warmth': Range(0.5, -0.2, 0.2)}

_KINDS: dict[str, type] = {item.name: type(item.default) for item in fields(Nuisances)}


def drawn(ranges: Mapping[str, Range], rng: np.random.Generator) -> Nuisances:
    """Draw the nuisances of one case."""
    values = {}
    for name, (share, low, high) in ranges.items():
        happens, value = rng.uniform() < share, rng.uniform(low, high)
        if happens:
            values[name] = _KINDS[name](round(value) if _KINDS[name] is int else value)
    return Nuisances(**values)


def described(ranges: Mapping[str, Range]) -> str:
    """Say how often each nuisance occurs."""
    if not ranges:
        return 'no nuisances: no noise, no JPEG, the tone curve known'
    if ranges == LINEAR:
        return 'no nuisances: no noise, no JPEG, intensities summed as they are'
    parts = []
    for name, (share, low, high) in ranges.items():
        span = '' if low == high else f' {low:g} to {high:g}'
        parts.append(f'{name}{span} in {share:.0%}')
    return 'light summed linearly; ' + ', '.join(parts)
