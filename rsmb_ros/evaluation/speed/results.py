"""What a run of the speed bench has found: collected, and as text and markdown."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import date
from typing import NamedTuple, TypeAlias

from rsmb_ros.core import Config
from rsmb_ros.report.html import Table

from ..environment import environment
from ..summary import median
from ..tables import ABSENT, markdown, plain
from .frame_tables import (
    floor_table,
    registration_ratio,
    registration_table,
    step_tables,
    total_ratio,
    total_table,
)
from .machine import Rates
from .probes import Memory, StartUp
from .rows import RowTimes
from .spread import number, size_name
from .stream import LEARNING, StreamFrame
from .stream_tables import (
    lost,
    rows_table,
    start_table,
    stream_table,
    warm_ratio,
    worst_exposure,
)
from .timing import COLD, FLAT, GIVEN, WARM, FrameTimes

Finding: TypeAlias = FrameTimes | Memory | RowTimes | StreamFrame | StartUp
NOTES = (
    'Times are medians over frames, wall clock, with quartiles. Ratios are taken frame by frame: '
    'ECC (findTransformECC as in RESULTS.md: homography, started by phase correlation, at most 100 '
    'iterations) and ours register the same frame one right after the other, in turns, both with '
    'the reference prepared and from the uint8 frame to the warped or rendered grey reference. '
    'Registration is all steps of a frame but change, layers, refine, layers again and other way. '
    'End to end is everything, beside ECC that registers only. Lost frames count with their time. '
    'A warm stream has been shown ten frames before; it starts from the last one.',
    'Floor: operations and bytes of fit (three linearisations of each image size) and rendering '
    'for the motion that was found, at the peak of a matrix product and of a copy measured in the '
    'same run on as many threads. No kernel that gathers pixels reaches that peak.',
)
# What is asked for: size of the frames -> most of ECC's time that registration may take.
MOST_OF_ECC = {(480, 640): 0.10, (720, 1280): 0.10}
TOTAL_OF_ECC = {COLD: 0.18, FLAT: 0.13}  # at these sizes, changes and all
ROWS_SECONDS = 1.0
EXPOSURE_ERROR = 0.01


class Goal(NamedTuple):
    """What is asked for and what was measured; NaN where it was not."""

    what: str
    limit: float
    measured: float

    @property
    def cells(self) -> list[str]:
        """Return a row of a table."""
        met = ABSENT if math.isnan(self.measured) else 'yes' if self.met else 'no'
        return [self.what, f'{self.limit:g}', number(self.measured, '.3g'), met]

    @property
    def met(self) -> bool:
        """Whether it is reached."""
        return self.measured <= self.limit


class SpeedResults:
    """
    Collects what is measured; keeps numbers only.

    Parameters
    ----------
    rates : Rates
        Peak of the machine.
    config : Config
        What all measurements share.
    settings : mapping
        How it was measured, for the page.

    """

    def __init__(self, rates: Rates, config: Config, settings: dict[str, object]) -> None:
        self._rates = rates
        self._about: dict[str, object] = {
            **settings,
            'threads': config.worker.threads,
            **environment(),
            'peak': f'{rates.flops / 1e9:.0f} GFLOP/s, {rates.bytes / 1e9:.1f} GB/s',
            'date': date.today().isoformat(),
        }
        self.frames: list[FrameTimes] = []
        self.memory: list[Memory] = []
        self.rows: list[RowTimes] = []
        self.stream: list[StreamFrame] = []
        self.starts: list[StartUp] = []

    def add(self, found: Finding) -> None:
        """Take one measurement."""
        if isinstance(found, FrameTimes):
            self.frames.append(found)
        elif isinstance(found, Memory):
            self.memory.append(found)
        elif isinstance(found, RowTimes):
            self.rows.append(found)
        elif isinstance(found, StreamFrame):
            self.stream.append(found)
        else:
            self.starts.append(found)

    def goals(self) -> list[Goal]:
        """Set what is asked for beside what was measured, of what was measured."""
        return [*self._ratio_goals(), *self._other_goals()]

    def tables(self) -> list[Table]:
        """Return a table for each part that was measured, what is asked for first."""
        goals = [goal.cells for goal in self.goals()]
        found = [Table('Asked for', ['asked for', 'at most', 'measured', 'met'], goals)]
        if self.frames:
            found.append(registration_table(self.frames, self._rates))
            found.append(total_table(self.frames))
        if self.frames or self.memory:
            found.append(floor_table(self.frames, self.memory, self._rates))
        if self.frames:
            found += step_tables(self.frames)
        if self.stream:
            found.append(stream_table(self.stream))
        if self.rows:
            found.append(rows_table(self.rows))
        if self.starts:
            found.append(start_table(self.starts))
        return [table for table in found if table.rows]

    def as_text(self) -> str:
        """Return the tables, aligned."""
        return '\n'.join([plain(table) for table in self.tables()] + list(NOTES))

    def as_markdown(self) -> str:
        """Return a page."""
        lines = ['# Speed', '', *(f'{note}\n' for note in NOTES)]
        lines += [f'* {name}: {value}' for name, value in self._about.items()]
        for table in self.tables():
            lines += ['', markdown(table)]
        return '\n'.join(lines).rstrip() + '\n'

    def _ratio_goals(self) -> Iterator[Goal]:
        for shape, limit in MOST_OF_ECC.items():
            group = [one for one in self.frames if one.shape == shape]
            for variant in (COLD, GIVEN, WARM):
                if any(variant in one.ours for one in group):
                    what = f'registration and rendering, {size_name(shape)}, {variant}, x ECC'
                    yield Goal(what, limit, registration_ratio(group, variant).median)
        for shape in MOST_OF_ECC:
            group = [one for one in self.frames if one.shape == shape]
            for variant, limit in TOTAL_OF_ECC.items():
                if any(variant in one.ours for one in group):
                    what = f'end to end, {size_name(shape)}, {variant}, x ECC'
                    yield Goal(what, limit, total_ratio(group, variant).median)

    def _other_goals(self) -> Iterator[Goal]:
        if self.rows:
            seconds = median(1e-3 * one.times.registration_ms for one in self.rows)
            yield Goal('row estimator, 3 degrees of freedom, 384x256, s', ROWS_SECONDS, seconds)
        if self.stream:
            error = worst_exposure(self.stream)
            what = f'stream: largest exposure error after {LEARNING} frames'
            yield Goal(what, EXPOSURE_ERROR, error)
            yield Goal('stream: frames not registered', 0, lost(self.stream))
            yield Goal('stream: warm over cold start', 1, warm_ratio(self.stream).median)
