"""Summaries as tables to read and as JSON."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

from rsmb_ros.report.html import Table

from .metrics import NAN, Score
from .published import Published, Range
from .summary import Summary, summarise

OURS = 'rsmb'  # methods whose names begin so come first
ABSENT = '-'
_HEAD_WIDTH = 12  # letters, in plain text
Value = float | Range


@dataclass(frozen=True)
class _Column:
    head: str
    keys: tuple[str, ...]  # fields of `Summary`, shown with slashes between them
    spec: str  # of one value
    scale: float = 1.0


_COLUMNS = (
    _Column('F mean / median', ('f_mean', 'f_median'), '.3f'),
    _Column('PWC %', ('pwc',), '.2f'),
    _Column('precision', ('precision',), '.3f'),
    _Column('objects recall / precision', ('objects_25.recall', 'objects_25.precision'), '.2f'),
    _Column(
        'false alarms unchanged / changed',
        ('false_alarms_unchanged', 'false_alarms_changed'),
        '.2f',
    ),
    _Column('registered %', ('registered',), '.0f', 100),
    _Column('rows t_x / t_y px', ('t_x_rmse', 't_y_rmse'), '.2f'),
    _Column('EPE median / p90 px', ('epe_median', 'epe_p90'), '.2f'),
    _Column('RMSE', ('rmse',), '.2f'),
    _Column('x true path median / p90', ('times_true_path', 'times_true_path_p90'), '.2f'),
    _Column('PSNR dB', ('psnr',), '.1f'),
    _Column('s per frame', ('seconds',), '.3f'),
    _Column('quartiles', ('seconds_q1', 'seconds_q3'), '.3f'),
    _Column('x ECC', ('times_ecc',), '.2f'),
)
NOTES = (
    'Objects: at IoU >= 0.25. False alarms: regions per image that touch no change. '
    'Rows, EPE, RMSE [grey levels] and PSNR: medians over registered cases only, on unchanged '
    'background. x true path: RMSE there, 5 px from all that is no ground, over that of the true '
    'path with the light that fits best. F counts 0 where a changed case is not registered.'
)


def suite_table(
    suite: str, summaries: Iterable[Summary], published: Sequence[Published] = ()
) -> Table:
    """
    Set accuracy and time of all methods side by side, one method a row.

    Parameters
    ----------
    suite : str
        Whose summaries are shown; the others are left out.
    summaries : iterable of Summary
        Shown in their order, but ours first.
    published : sequence of Published
        Rows for the end.

    """
    shown = [summary for summary in summaries if summary.suite == suite]
    shown.sort(key=lambda summary: not summary.method.startswith(OURS))  # stable
    rows = [_row(summary) for summary in shown] + [_row(one) for one in published]
    changed = f', {shown[0].changed} of {shown[0].cases} cases changed' if shown else ''
    return Table(f'{suite}{changed}', ['method', *(column.head for column in _COLUMNS)], rows)


def plain(table: Table) -> str:
    """Return a table as aligned text; long headings are broken over several lines."""
    heads = [textwrap.wrap(head, _HEAD_WIDTH) for head in table.head]
    height = max(len(head) for head in heads)
    padded = [[''] * (height - len(head)) + head for head in heads]
    lines = [*zip(*padded, strict=True), *table.rows]
    widths = [max(len(line[n]) for line in lines) for n in range(len(heads))]
    text = [_aligned(line, widths) for line in lines]
    rule = '-' * (sum(widths) + 2 * (len(widths) - 1))
    return '\n'.join([table.title, *text[:height], rule, *text[height:]]) + '\n'


def markdown(table: Table) -> str:
    """Return a table as GitHub markdown, its title as a bold line above."""
    rule = ['---', *['---:'] * (len(table.head) - 1)]
    lines = [f'| {" | ".join(row)} |' for row in (table.head, rule, *table.rows)]
    return '\n'.join([f'**{table.title}**', '', *lines]) + '\n'


def to_json(scores: Sequence[Score], about: Mapping[str, object] | None = None) -> str:
    """
    Return everything measured as JSON: `about`, summaries and each case with each method.

    Parameters
    ----------
    scores : sequence of Score
    about : mapping, optional
        How it was measured: versions, machine, sources of the methods.

    Returns
    -------
    str
        What is not finite (not known, PSNR of equal images) is null.

    """
    content = {
        'about': dict(about or {}),
        'summaries': [summary.as_dict() for summary in summarise(scores)],
        'cases': [score.as_dict() for score in scores],
    }
    return json.dumps(_finite(content), indent=1, allow_nan=False) + '\n'


def _row(of: Summary | Published) -> list[str]:
    return [of.method, *(_cell(of, column) for column in _COLUMNS)]


def _cell(of: Summary | Published, column: _Column) -> str:
    texts = [_text(_value(of, key), column) for key in column.keys]
    return ABSENT if set(texts) == {ABSENT} else ' / '.join(texts)


def _value(of: Summary | Published, key: str) -> Value:
    return of.values.get(key, NAN) if isinstance(of, Published) else attrgetter(key)(of)


def _text(value: Value, column: _Column) -> str:
    if isinstance(value, tuple):
        return '-'.join(_text(end, column) for end in value)
    return ABSENT if math.isnan(value) else format(column.scale * value, column.spec)


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> str:
    """Join cells, the first to the left, numbers to the right."""
    first, *rest = cells
    padded = [cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True)]
    return '  '.join([first.ljust(widths[0]), *padded]).rstrip()


def _finite(content: object) -> object:
    """Replace what JSON cannot hold by None, at any depth."""
    if isinstance(content, Mapping):
        return {name: _finite(value) for name, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
