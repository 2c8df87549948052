"""What a run has found: what each part is worth, as text and markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date

from rsmb_ros.report.html import Table

from ..environment import environment
from ..metrics import NAN, Score, ratio
from ..speed.spread import Spread, number
from ..summary import mean, summarise
from ..tables import markdown, plain
from .measure import ALL_ON, ALONE, PERSISTENT, Measured
from .switches import SWITCHES

ALL_SUITES = 'all suites'
HARMED = 0.01  # of F, or a false alarm: what counts as another result
NOTES = (
    'One part is switched off at a time, all others are on; the same cases, one after the other. '
    'Differences are to everything on, means over cases: F over those in which something changed, '
    'false alarms (regions that touch no change) over all. Worse, better: cases whose F differs by '
    'more than 0.01, or that have other false alarms. Times are wall clock with the preparation of '
    'the reference, their ratio is taken case by case.'
)


class AblationResults:
    """
    Collects case by case; keeps numbers only.

    Parameters
    ----------
    about : mapping
        How it was measured, for the page.

    """

    def __init__(self, about: dict[str, object]) -> None:
        self._about = {**about, **environment(), 'date': date.today().isoformat()}
        self.cases: list[Measured] = []
        self.frames: list[Measured] = []

    def add(self, found: Measured) -> None:
        """Take one case, or a frame of a stream."""
        (self.frames if PERSISTENT in found.scores else self.cases).append(found)

    def tables(self) -> list[Table]:
        """Return all suites together, each suite, each stream."""
        suites = _by_suite(self.cases)
        found = [_table(ALL_SUITES, self.cases, ALL_ON)] if len(suites) > 1 else []
        found += [_table(suite, group, ALL_ON) for suite, group in suites.items()]
        return found + [
            _table(name, group, PERSISTENT) for name, group in _by_suite(self.frames).items()
        ]

    def as_text(self) -> str:
        """Return the tables, aligned."""
        return '\n'.join([*map(plain, self.tables()), NOTES])

    def as_markdown(self) -> str:
        """Return a page."""
        lines = ['# Ablation', '', NOTES, '']
        lines += [f'* {name}: {value}' for name, value in self._about.items()]
        lines += ['', 'Without', '']
        lines += [f'* **{one.name}** ({one.group}): {one.instead}' for one in SWITCHES]
        lines += [f'* **persistence**: {ALONE}']
        for table in self.tables():
            lines += ['', markdown(table)]
        return '\n'.join(lines).rstrip() + '\n'


def _by_suite(found: Iterable[Measured]) -> dict[str, list[Measured]]:
    groups: dict[str, list[Measured]] = {}
    for one in found:
        groups.setdefault(next(iter(one.scores.values())).suite, []).append(one)
    return groups


def _table(title: str, cases: Sequence[Measured], base: str) -> Table:
    """One row for everything on, one for each part that is off."""
    names = [base, *(name for name in cases[0].scores if name != base)]
    rows = [_row(name, cases, base) for name in names]
    head = ['switched off', 'F mean', 'difference', 'objects recall / precision']
    head += ['false alarms', 'difference', 'worse, better', 'judged %', 'EPE px', 'RMSE']
    head += ['ms', 'quartiles', 'x base', 'quartiles']
    changed = sum(one.scores[base].changed for one in cases)
    return Table(f'{title}, {changed} of {len(cases)} changed', head, rows)


def _row(name: str, cases: Sequence[Measured], base: str) -> list[str]:
    own = [one.scores[name] for one in cases]
    full = [one.scores[base] for one in cases]
    pairs = list(zip(own, full, strict=True))
    (summary,) = summarise(replace(one, case='all/0') for one in own)
    alarms = [float(one.objects_25.false_alarms) for one in own]
    more = mean(a - one.objects_25.false_alarms for a, one in zip(alarms, full, strict=True))
    times = Spread.of(1e3 * one.seconds for one in own)
    slower = Spread.of(ratio(one.seconds, other.seconds) for one, other in pairs)
    same = name == base
    worse = sum(_loss(one, other) > 0 for one, other in pairs)
    better = sum(_loss(one, other) < 0 for one, other in pairs)
    objects = summary.objects_25
    return [
        name,
        number(summary.f_mean, '.3f'),
        number(NAN if same else mean(a.pixels.f - b.pixels.f for a, b in pairs), '+.3f'),
        f'{number(objects.recall, ".2f")} / {number(objects.precision, ".2f")}',
        number(mean(alarms), '.2f'),
        number(NAN if same else more, '+.2f'),
        '-' if same else f'{worse}, {better}',
        number(100 * summary.judged, '.1f'),
        number(summary.epe_median, '.3f'),
        number(summary.rmse, '.2f'),
        *times.cells('.0f'),
        *(('-', '-') if same else slower.cells('.2f')),
    ]


def _loss(own: Score, full: Score) -> int:
    """1: worse than with everything on, -1: better, 0: much the same."""
    lost = full.pixels.f - own.pixels.f
    if not math.isnan(lost) and abs(lost) > HARMED:
        return 1 if lost > 0 else -1
    alarms = own.objects_25.false_alarms - full.objects_25.false_alarms
    return (alarms > 0) - (alarms < 0)
