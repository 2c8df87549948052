"""What a run of suites and methods has found: collected, and as text, markdown and HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date

import numpy as np

from rsmb_ros.report.evaluation_sheet import case_sheet
from rsmb_ros.report.html import Table

from .environment import environment
from .metrics import Score
from .published import PUBLISHED
from .run import CaseRun
from .static_table import STATIC_NOTES, static_table
from .summary import summarise, worst
from .tables import NOTES, markdown, plain, suite_table, to_json

WORST = 5  # cases of a suite that are shown
LEGEND = (
    'The worst cases of each suite. Colours are explained below each sheet; what is ignored is the '
    'blurred rim of a change, a shadow, or lies outside the reference.'
)


class Results:
    """
    Collects case by case; keeps the numbers, and pictures of the worst cases only.

    Parameters
    ----------
    shown : str
        Method whose worst cases are shown.
    sources : mapping
        Method -> where it comes from.
    about : mapping
        How it was measured: suites, options.

    """

    def __init__(self, shown: str, sources: Mapping[str, str], about: Mapping[str, object]) -> None:
        self.scores: list[Score] = []
        self._shown = shown
        self._sources = sources
        self._about = {**about, **environment(), 'date': date.today().isoformat()}
        self._sheets: dict[str, np.ndarray] = {}

    def add(self, run: CaseRun) -> None:
        """Take one case."""
        self.scores += run.scores.values()
        score = run.scores[self._shown]
        names = {one.case for one in self.worst(score.suite)}
        if score.case in names:
            self._sheets[score.case] = _sheet(run, self._shown)
        ours = [name for name in self._sheets if name.rpartition('/')[0] == score.suite]
        for name in set(ours) - names:
            del self._sheets[name]

    def worst(self, suite: str) -> list[Score]:
        """Return the worst cases of the shown method on a suite, worst first."""
        of_suite = [one for one in self.scores if one.suite == suite and one.method == self._shown]
        return worst(of_suite, WORST)

    @property
    def suites(self) -> list[str]:
        """Names of the suites, in their order."""
        return list(dict.fromkeys(score.suite for score in self.scores))

    def sheets(self) -> list[tuple[Score, np.ndarray]]:
        """Return score and contact sheet of the worst cases of all suites."""
        return [
            (score, self._sheets[score.case])
            for suite in self.suites
            for score in self.worst(suite)
        ]

    def tables(self) -> list[Table]:
        """Return a table a suite."""
        summaries = summarise(self.scores)
        return [suite_table(suite, summaries, PUBLISHED.get(suite, ())) for suite in self.suites]

    def static_table(self) -> Table | None:
        """Return what the shown method makes of static objects, if there are any."""
        return static_table(self.scores, self._shown)

    def as_text(self) -> str:
        """Return the tables and the names of the worst cases."""
        parts = [plain(table) for table in self.tables()]
        parts += [f'{line}\n' for line in self._worst_lines()]
        statics = self.static_table()
        if statics:
            return '\n'.join([*parts, plain(statics), NOTES, STATIC_NOTES])
        return '\n'.join([*parts, NOTES])

    def as_markdown(self, frequencies: Mapping[str, Sequence[str]]) -> str:
        """Return a page; `frequencies` says of each suite how often which nuisance occurs."""
        lines = ['# Results', '', NOTES, '']
        lines += [f'* {name}: {value}' for name, value in self._about.items()]
        lines += ['', '## Methods', '']
        lines += [f'* `{name}`: {source}' for name, source in self._sources.items()]
        lines += ['', '## Suites', '']
        for name, said in frequencies.items():
            lines += [f'* **{name}**: {"; ".join(said) or "as it is"}']
        for table, suite in zip(self.tables(), self.suites, strict=True):
            lines += ['', f'## {suite}', '', markdown(table)]
            lines += [f'* {line}' for line in self._worst_lines(suite)]
        statics = self.static_table()
        if statics:
            lines += ['', '## Static objects', '', STATIC_NOTES, '', markdown(statics)]
        return '\n'.join(lines) + '\n'

    def as_json(self) -> str:
        """Return everything measured."""
        return to_json(self.scores, {**self._about, 'methods': dict(self._sources)})

    def summary(self) -> dict[str, str]:
        """Return what stands on top of a page."""
        return {name: str(value) for name, value in self._about.items()}

    def _worst_lines(self, only: str | None = None) -> list[str]:
        """Say of each suite which cases are the worst."""
        lines = []
        for suite in [only] if only else self.suites:
            found = [f'{one.case} ({outcome_line(one)})' for one in self.worst(suite)]
            if found:
                lines.append(f'Worst of {self._shown} in {suite}: {"; ".join(found)}')
        return lines


def outcome_line(score: Score) -> str:
    """Say in a few words how a method did on a case."""
    if not score.registered:
        return f'not registered: {score.reason}'
    objects = score.objects_25
    alarms = f'{objects.false_alarms} false alarms'
    if not score.changed:
        return alarms
    return f'F {score.pixels.f:.2f}, {objects.tp} of {objects.tp + objects.fn} objects, {alarms}'


def _sheet(run: CaseRun, method: str) -> np.ndarray:
    outcome, case = run.outcomes[method], run.case
    return case_sheet(
        f'{case.name}: {outcome_line(run.scores[method])}',
        case.reference,
        case.live,
        outcome.registration.registered if outcome.registration else None,
        outcome.change,
        outcome.valid,
        case.label,
    )
