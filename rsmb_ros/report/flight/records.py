"""What is remembered of every frame: a line of numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core.types import REGISTERED, Result

from ..words import numbers, percent


@dataclass(frozen=True)
class FrameRecord:
    """One frame in numbers; NaN where it is not registered."""

    index: int  # number of the frame in its bag
    time_ns: int  # of its stamp
    registered: bool
    reason: str  # '' when registered
    changes: int
    statics: int
    score: float  # the highest of its changes, 0 without
    exposure_rows: float
    unknown: float  # share of its pixels, 0..1
    gain: float


def record_of(index: int, time_ns: int, result: Result) -> FrameRecord:
    """Return the numbers of a frame."""
    changes = result.changes
    return FrameRecord(
        index=index,
        time_ns=time_ns,
        registered=result.status == REGISTERED,
        reason=result.reason,
        changes=len(changes),
        statics=len(result.regions) - len(changes),
        score=max((region.score for region in changes), default=0.0),
        exposure_rows=result.exposure_rows,
        unknown=float(np.mean(result.valid_mask == 0)),
        gain=result.gain,
    )


def reasons(records: Sequence[FrameRecord]) -> list[tuple[str, int]]:
    """Return why frames were not registered, without their numbers, the most frequent first."""
    found = Counter(one.reason.split(':')[0] for one in records if not one.registered)
    return sorted(found.items(), key=lambda item: (-item[1], item[0]))


def outcome(record: FrameRecord) -> list[str]:
    """Return what came out of a frame, in words, the most important first."""
    if not record.registered:
        return ['not registered', record.reason]
    parts = [numbers(record.changes, 'change') if record.changes else 'no change']
    if record.statics:
        parts.append(numbers(record.statics, 'static object'))
    parts.append(f'exposure {record.exposure_rows:.0f} rows')
    parts.append(f'{percent(record.unknown)} unknown')
    return parts
