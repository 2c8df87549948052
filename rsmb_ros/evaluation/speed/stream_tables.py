"""Tables of the stream, of the row estimator and of the start."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rsmb_ros.report.html import Table

from ..metrics import NAN, ratio
from .probes import StartUp
from .rows import RowTimes
from .spread import Spread, number, size_name
from .stream import LEARNING, StreamFrame
from .timing import has_memory


def stream_table(frames: Sequence[StreamFrame]) -> Table:
    """A frame inside the stream beside the same frame alone."""
    late = learned(frames)
    errors = Spread.of(100 * one.exposure_error for one in late)
    rows = [
        ['frames', str(len(frames)), ''],
        ['not registered', str(lost(frames)), ''],
        ['registration inside the stream, ms', *_ms(one.stream.registration_ms for one in late)],
        [
            'the same frames alone, ms',
            *_ms(one.alone.registration_ms for one in late if one.alone),
        ],
        ['inside / alone', *warm_ratio(frames).cells('.2f')],
        ['end to end inside the stream, ms', *_ms(one.stream.total_ms for one in late)],
        ['end to end alone, ms', *_ms(one.alone.total_ms for one in late if one.alone)],
        [f'exposure error after {LEARNING} frames, %', *errors.cells('.2f')],
        ['the largest of them, %', number(100 * worst_exposure(frames), '.2f'), ''],
        ['within 1 %, %', number(100 * share_within(frames, 0.01), '.0f'), ''],
        ['rows inside the stream, px', *Spread.of(one.row_error for one in late).cells('.3f')],
        ['rows alone, px', *Spread.of(one.row_error_alone for one in late).cells('.3f')],
    ]
    memory = '' if has_memory() else '; this version registers each frame alone'
    return Table(f'A stream at 640x480{memory}', ['stream', 'median', 'quartiles'], rows)


def rows_table(rows: Sequence[RowTimes]) -> Table:
    """Time of the row estimator, by size."""
    lines = []
    for shape in dict.fromkeys(one.shape for one in rows):
        group = [one.times for one in rows if one.shape == shape]
        lines.append(
            [
                size_name(shape),
                str(len(group)),
                str(sum(not one.registered for one in group)),
                *Spread.of(1e-3 * one.registration_ms for one in group).cells('.3f'),
                *Spread.of(1e-3 * one.total_ms for one in group).cells('.3f'),
            ]
        )
    head = ['size', 'frames', 'not registered', 'registration s', 'quartiles']
    head += ['end to end s', 'quartiles']
    return Table('Row estimator, 3 degrees of freedom', head, lines)


def start_table(starts: Sequence[StartUp]) -> Table:
    """Time until the first frame can come."""
    rows = []
    for cached in dict.fromkeys(one.cached for one in starts):
        group = [one for one in starts if one.cached == cached]
        rows.append(
            [
                'kernels on the disk' if cached else 'kernels to compile',
                str(len(group)),
                *Spread.of(one.imports for one in group).cells('.1f'),
                *Spread.of(one.warm_up for one in group).cells('.1f'),
            ]
        )
    head = ['start', 'times', 'imports s', 'quartiles', 'warm-up s', 'quartiles']
    return Table('Start', head, rows)


def learned(frames: Iterable[StreamFrame]) -> list[StreamFrame]:
    """Return the frames after those an estimate may take."""
    return [one for one in frames if one.index >= LEARNING]


def lost(frames: Iterable[StreamFrame]) -> int:
    """Return how many frames were not registered."""
    return sum(not one.stream.registered for one in frames)


def warm_ratio(frames: Iterable[StreamFrame]) -> Spread:
    """Return registration inside the stream over that of the same frame alone."""
    return Spread.of(
        ratio(one.stream.registration_ms, one.alone.registration_ms)
        for one in learned(frames)
        if one.alone
    )


def worst_exposure(frames: Iterable[StreamFrame]) -> float:
    """Return the largest relative error of the exposure once it is learned, NaN without any."""
    return max(
        (one.exposure_error for one in learned(frames) if one.stream.registered), default=NAN
    )


def share_within(frames: Iterable[StreamFrame], limit: float) -> float:
    """Return the share of the learned frames whose exposure is right to `limit`, 0..1."""
    late = learned(frames)
    return ratio(sum(one.exposure_error <= limit for one in late), len(late))


def _ms(values: Iterable[float]) -> tuple[str, str]:
    return Spread.of(values).cells('.1f')
