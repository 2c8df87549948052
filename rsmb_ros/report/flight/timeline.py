"""All frames on one strip: changes, status, exposure and what was unknown."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ..shapes import bars, line
from ..words import percent
from .records import FrameRecord, outcome

MOST_BINS = 240  # bars that a phone can still show
HEIGHT = 40  # of one lane, in its own units
_STATUS_HEIGHT = 12
_BAR = 0.8  # of a bin
_HEADROOM = 1.15  # of the largest exposure


@dataclass(frozen=True)
class Lane:
    """One quantity over all frames."""

    name: str
    note: str  # its scale or its numbers
    height: int
    bars: str = ''  # SVG paths
    alarms: str = ''
    losses: str = ''
    curve: str = ''


@dataclass(frozen=True)
class Bin:
    """One frame, or some next to each other."""

    label: str
    target: str  # id of what it leads to


@dataclass(frozen=True)
class Timeline:
    """Everything the template draws."""

    bins: Sequence[Bin]
    lanes: Sequence[Lane]
    marks: Sequence[tuple[float, str]]  # place 0..100 and text below
    per_bin: int  # frames


def timeline(
    records: Sequence[FrameRecord],
    shown: Collection[int],
    target: Callable[[FrameRecord], str],
    clock: Callable[[FrameRecord], str],
) -> Timeline:
    """
    Return the strip of all frames.

    Parameters
    ----------
    records : sequence of FrameRecord
        At least one.
    shown : collection of int
        Numbers of the frames that have pictures.
    target : callable
        Id of the element that tells about a frame.
    clock : callable
        Time of a frame in words.

    """
    per_bin = math.ceil(len(records) / MOST_BINS)
    groups = [records[n : n + per_bin] for n in range(0, len(records), per_bin)]
    chosen = [_telling(group, shown) for group in groups]
    bins = [
        Bin(_label(group, one, clock), target(one))
        for group, one in zip(groups, chosen, strict=True)
    ]
    places = sorted({0, (len(groups) - 1) // 2, len(groups) - 1})
    told = [groups[n][0] for n in places[:-1]] + [records[-1]]
    marks = [
        (100 * (n + 0.5) / len(groups), f'{one.index} · {clock(one)}')
        for n, one in zip(places, told, strict=True)
    ]
    lanes = (
        _changes(groups),
        _status(groups),
        _exposure(groups),
        _unknown(groups),
    )
    return Timeline(bins, lanes, marks, per_bin)


def _telling(group: Sequence[FrameRecord], shown: Collection[int]) -> FrameRecord:
    """Return the frame of a bin that one wants to see."""
    return max(group, key=lambda one: (one.index in shown, one.changes, one.score, -one.index))


def _label(
    group: Sequence[FrameRecord], one: FrameRecord, clock: Callable[[FrameRecord], str]
) -> str:
    frames = f'frame {one.index}, {clock(one)}'
    if len(group) > 1:
        frames = f'frames {group[0].index} to {group[-1].index}; {frames}'
    return f'{frames}: {", ".join(outcome(one))}'


def _changes(groups: Sequence[Sequence[FrameRecord]]) -> Lane:
    most = [max(one.changes for one in group) for group in groups]
    top = max(most)
    heights = HEIGHT * np.array(most) / max(top, 1)
    with_some = sum(one.changes > 0 for group in groups for one in group)
    note = f'in {with_some:,} frames, at most {top}' if top else 'none'
    return Lane('Changes', note, HEIGHT, alarms=_bars(heights, HEIGHT))


def _status(groups: Sequence[Sequence[FrameRecord]]) -> Lane:
    lost = np.array([any(not one.registered for one in group) for group in groups])
    count = sum(not one.registered for group in groups for one in group)
    note = f'{count:,} not registered' if count else 'every frame'
    thin = np.where(lost, 0, _STATUS_HEIGHT / 3)
    tall = np.where(lost, _STATUS_HEIGHT, 0)
    height = _STATUS_HEIGHT
    return Lane('Registered', note, height, _bars(thin, height), losses=_bars(tall, height))


def _exposure(groups: Sequence[Sequence[FrameRecord]]) -> Lane:
    values = np.array([_median([one.exposure_rows for one in group]) for group in groups])
    known = values[np.isfinite(values)]
    if not known.size:
        return Lane('Exposure', 'not known', HEIGHT)
    low, high = known.min(), known.max()
    note = f'{low:.0f} rows' if round(low) == round(high) else f'{low:.0f} to {high:.0f} rows'
    y = HEIGHT * (1 - values / max(_HEADROOM * high, 1.0))
    return Lane('Exposure', note, HEIGHT, curve=_steps(y))


def _unknown(groups: Sequence[Sequence[FrameRecord]]) -> Lane:
    shares = np.array([max(one.unknown for one in group) for group in groups])
    note = f'{percent(shares.min())} to {percent(shares.max())} of the frame'
    return Lane('Unknown', note, HEIGHT // 2, bars=_bars(shares * HEIGHT / 2, HEIGHT / 2))


def _bars(heights: np.ndarray, base: float) -> str:
    left = np.arange(len(heights)) + (1 - _BAR) / 2
    return bars(left, heights, base, _BAR)


def _steps(y: np.ndarray) -> str:
    """Return a line as wide as its bin for each value: a single frame is seen, too."""
    n = np.arange(len(y))
    return line(np.stack([n, n + 1], axis=1).ravel(), np.repeat(y, 2))


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan
