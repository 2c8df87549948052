"""What the page of a flight says, in the words and numbers that its template shows."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..outlines import outline_path
from ..words import numbers, percent
from .places import Box, Place
from .records import FrameRecord, outcome, reasons
from .settings import settings
from .shown import ShownFrame
from .timeline import timeline

if TYPE_CHECKING:
    from .report import FlightReport, Sheet

MOST_PLACES = {'change': 48, 'static': 12}  # with pictures
UNFOLDED = 8  # places shown at once
MOST_ROWS = 2000  # of the table of frames
_NS = 1e9
_YEAR_2000 = 946_684_800 * 10**9  # ns; earlier stamps are of no calendar


@dataclass(frozen=True)
class Pin:
    """A number above a region, on the picture of a reference or a frame."""

    kind: str  # as in `Region`
    number: int  # of the place
    left: float  # [% of the picture]
    top: float
    title: str
    box: Box | None = None  # on the reference

    @property
    def place(self) -> str:
        """Its place as a style, such that all of it can be seen."""
        left = f'clamp(1rem, {self.left:.2f}%, calc(100% - 1rem))'
        return f'left: {left}; top: clamp(2.2rem, {self.top:.2f}%, 100%)'


class Clock:
    """Times of frames in words, from the first one on."""

    def __init__(self, records: Sequence[FrameRecord]) -> None:
        self._start = records[0].time_ns if records else 0
        self._known = len({one.time_ns for one in records}) > 1 or len(records) == 1
        self._end = records[-1].time_ns if records else 0

    def of(self, record: FrameRecord) -> str:
        """Return the time of a frame since the first one."""
        return f'{(record.time_ns - self._start) / _NS:.1f} s'

    @property
    def span(self) -> str:
        """How long the flight took, '' where nobody knows."""
        return f'{(self._end - self._start) / _NS:.1f} s' if self._known else ''

    @property
    def date(self) -> str:
        """When it began, '' where the stamps are of no calendar."""
        if self._start < _YEAR_2000:
            return ''
        begin = datetime.fromtimestamp(self._start / _NS, timezone.utc)
        return begin.strftime('%Y-%m-%d %H:%M:%S UTC')


def page_of(
    report: FlightReport, facts: Mapping[str, str], warnings: Sequence[str]
) -> dict[str, Any]:
    """Return everything the template needs."""
    records, frames = report.records, report.frames()
    clock = Clock(records)
    places = {kind: book.ranked() for kind, book in report.books.items()}
    shown = {kind: found[: MOST_PLACES[kind]] for kind, found in places.items()}
    left_out = {
        kind: len(places[kind]) - len(shown[kind]) + report.books[kind].dropped for kind in places
    }
    numbered = {id(one): n for found in shown.values() for n, one in enumerate(found, 1)}
    by_index = {one.index: one for one in records}
    with_pictures = {one.record.index for one in frames}
    rows = records if len(records) <= MOST_ROWS else [f.record for f in frames]
    changed = [one for one in settings(report.config) if one.changed]

    target = partial(_target, with_pictures=with_pictures, listed=len(rows) == len(records))

    return {
        'title': report.title,
        'verdict': verdict(records, places['change'], report.books['change'].dropped),
        'warnings': warnings,
        'lost': reasons(records),
        'tiles': tiles(records, clock, report.sheets),
        'facts': {**facts, **({'recorded': clock.date} if clock.date else {})},
        'places': shown,
        'left_out': left_out,
        'unfolded': UNFOLDED,
        'times': {index: clock.of(one) for index, one in by_index.items()},
        'target': lambda index: target(by_index[index]),
        'frame_count': len(records),
        'timeline': timeline(records, with_pictures, target, clock.of) if records else None,
        'frames': frames,
        'frame_pins': {one.record.index: _frame_pins(one, numbered) for one in frames},
        'parts': outcome,
        'opened': _opened(places['change'], frames),
        'sheets': [sheet for sheet in report.sheets if sheet.picture],
        'sheet_count': len(report.sheets),
        'never': [_never_judged(sheet) for sheet in report.sheets],
        'sheet_pins': [_sheet_pins(n, sheet, shown) for n, sheet in enumerate(report.sheets)],
        'rows': rows,
        'changed_settings': changed,
        'settings': settings(report.config),
    }


def verdict(records: Sequence[FrameRecord], changes: Sequence[Place], dropped: int) -> str:
    """Return in one sentence what an operator wants to know first."""
    if not records:
        return 'There was no frame.'
    if not any(one.registered for one in records):
        return 'No frame could be registered: nothing is known about changes.'
    count = len(changes) + dropped
    if not count:
        return 'Nothing changed where it could be judged.'
    frames = sum(one.changes > 0 for one in records)
    at_least = 'about ' if dropped else ''
    return (
        f'{at_least}{numbers(count, "place")} changed, '
        f'seen in {frames:,} of {numbers(len(records), "frame")}.'
    ).capitalize()


def tiles(
    records: Sequence[FrameRecord], clock: Clock, sheets: Sequence[Sheet]
) -> list[tuple[str, str, str]]:
    """Return the numbers on top: name, value and a word about it."""
    registered = [one for one in records if one.registered]
    lost = len(records) - len(registered)
    exposures = [one.exposure_rows for one in registered if math.isfinite(one.exposure_rows)]
    unknown = [one.unknown for one in registered]
    found = [
        ('Frames', f'{len(records):,}', clock.span),
        ('Registered', f'{len(registered):,}', f'{lost:,} not' if lost else 'all'),
    ]
    if exposures:
        low, high = f'{min(exposures):.0f}', f'{max(exposures):.0f}'
        span = 'in every frame' if low == high else f'{low} to {high}'
        found.append(('Exposure', f'{np.median(exposures):.0f} rows', span))
    if unknown:
        worst = f'at most {percent(max(unknown))}'
        found.append(('Unknown in a frame', f'{percent(float(np.median(unknown)))}', worst))
    shares = [sheet.coverage.share for sheet in sheets if sheet.coverage]
    if shares and registered:
        word = 'at least once' if len(shares) == 1 else 'the best of the references'
        found.append(('Reference judged', percent(max(shares)), word))
    return found


def _target(record: FrameRecord, with_pictures: Collection[int], listed: bool) -> str:
    """Return the id of what tells about a frame: its pictures, its row, or those nearest to it."""
    if listed and record.index not in with_pictures:
        return f'row-{record.index}'
    near = min(with_pictures, key=lambda index: (abs(index - record.index), index))
    return f'frame-{near}'


def _opened(changes: Sequence[Place], frames: Sequence[ShownFrame]) -> int | None:
    """Return the number of the frame that is shown unfolded: where the first change is seen."""
    known = [frame.record.index for frame in frames]
    wanted = [place.best_frame for place in changes if place.best_frame in known]
    return next(iter([*wanted, *known]), None)


def _frame_pins(frame: ShownFrame, numbered: Mapping[int, int]) -> list[Pin]:
    """Return the changes of a frame that have a number."""
    return [
        Pin(
            'change',
            numbered[id(mark.place)],
            100 * (mark.region.x + mark.region.width / 2) / frame.width,
            100 * mark.region.y / frame.height,
            f'score {mark.region.score:.2f}',
        )
        for mark in frame.marks
        if mark.region.kind == 'change' and id(mark.place) in numbered
    ]


def _sheet_pins(number: int, sheet: Sheet, shown: Mapping[str, Sequence[Place]]) -> list[Pin]:
    """Return the places on one reference, the most important last: on top."""
    if sheet.coverage is None:
        return []
    rows, cols = sheet.shape
    pins = []
    for kind in ('static', 'change'):
        for n, place in reversed(list(enumerate(shown[kind], 1))):
            if place.reference == number and place.box:
                left = min(max(100 * place.box.middle[0] / cols, 0.0), 100.0)
                top = min(max(100 * place.box.top / rows, 0.0), 100.0)
                pins.append(Pin(kind, n, left, top, f'{kind} {n}', place.box))
    return pins


def _never_judged(sheet: Sheet) -> str:
    """Return the outline of what no frame judged [px of the reference]."""
    if sheet.coverage is None:
        return ''
    cell = sheet.coverage.cell
    missing = np.pad(~sheet.coverage.judged, 0)
    wide = np.kron(missing, np.ones((2, 2), np.uint8))  # one cell alone has an area, too
    return outline_path(wide, move=lambda points: (points + 0.5) * cell / 2)
