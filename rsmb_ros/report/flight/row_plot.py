"""How the camera moved while a frame was read: t_x, t_y and r_z over the rows, as an SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core.types import Result

from ..shapes import band, line, ticks

WIDTH, HEIGHT = 360, 324  # of the drawing
_LEFT, _RIGHT = 40, 8  # margins
_PANEL, _GAP, _TOP = 64, 32, 24
_POINTS = 160  # of one curve
MINUS = '\N{MINUS SIGN}'
_SIGMAS = 2.0  # half the height of the band
_LEAST = {'t_x': 1.0, 't_y': 1.0, 'r_z': 0.1}  # px, px, deg: a still camera is a flat line


@dataclass(frozen=True)
class Panel:
    """One curve with its axis, in the coordinates of the drawing."""

    name: str  # 't_x'
    letter: str  # 't'
    index: str  # 'x'
    unit: str
    top: float
    bottom: float
    curve: str  # SVG paths
    band: str
    marks: Sequence[tuple[float, str]]  # height and text of each number at the axis


@dataclass(frozen=True)
class RowPlot:
    """Everything the template draws."""

    panels: Sequence[Panel]
    row_marks: Sequence[tuple[float, str]]  # place and text of each number below
    exposure: tuple[float, float, str] | None  # left end, width and text of its bar
    left: float
    right: float
    width: int
    height: int
    description: str  # for those who do not see it


def row_plot(result: Result) -> RowPlot:
    """
    Return the drawing of one registered frame.

    The band is what two standard deviations of a row's place may be off: in px for t_x and t_y;
    for r_z the angle that moves the end of the row by as much.
    """
    rows, cols = result.valid_mask.shape
    some = np.unique(np.linspace(0, rows - 1, _POINTS).round().astype(np.int64))
    x = _LEFT + (WIDTH - _LEFT - _RIGHT) * some / max(rows - 1, 1)
    off = _SIGMAS * result.row_uncertainty[some]
    angle = np.degrees(off / (cols / 2))
    panels = [
        _panel(0, 't_x', 'px', x, result.row_motion[some, 0], off),
        _panel(1, 't_y', 'px', x, result.row_motion[some, 1], off),
        _panel(2, 'r_z', 'deg', x, result.row_motion[some, 2], angle),
    ]
    scale = (WIDTH - _LEFT - _RIGHT) / max(rows - 1, 1)
    marks = [(_LEFT + scale * row, f'{row:.0f}') for row in ticks(0, rows - 1, 4)]
    return RowPlot(
        panels, marks, _exposure(result, scale), _LEFT, WIDTH - _RIGHT, WIDTH, HEIGHT,
        _described(result),
    )  # fmt: skip


def _panel(
    number: int, name: str, unit: str, x: np.ndarray, values: np.ndarray, off: np.ndarray
) -> Panel:
    top = _TOP + number * (_PANEL + _GAP)
    low, high = _limits(values, off, _LEAST[name])

    def height(value: np.ndarray) -> np.ndarray:
        return np.clip(top + _PANEL * (high - value) / (high - low), top, top + _PANEL)

    marks = [
        (float(height(np.float64(one))), f'{one:g}'.replace('-', MINUS)) for one in ticks(low, high)
    ]
    letter, index = name.split('_')
    return Panel(
        name=name,
        letter=letter,
        index=index,
        unit=unit,
        top=top,
        bottom=top + _PANEL,
        curve=line(x, height(values)),
        band=band(x, height(values - off), height(values + off)),
        marks=marks,
    )


def _limits(values: np.ndarray, off: np.ndarray, least: float) -> tuple[float, float]:
    """Return the ends of an axis: all of the curve, and of the band as much again at most."""
    if not np.isfinite(values).any():
        return -least, least
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    span = max(high - low, least)
    known = np.isfinite(values) & np.isfinite(off)
    if known.any():
        low = max(float((values - off)[known].min()), low - span)
        high = min(float((values + off)[known].max()), high + span)
    pad = max(0.08 * (high - low), (least - (high - low)) / 2)
    return low - pad, high + pad


def _exposure(result: Result, scale: float) -> tuple[float, float, str] | None:
    if not np.isfinite(result.exposure_rows):
        return None
    width = min(max(scale * result.exposure_rows, 1.0), WIDTH - _LEFT - _RIGHT)
    return _LEFT, width, f'exposure {result.exposure_rows:.0f} rows'


def _described(result: Result) -> str:
    parts = []
    for column, (name, unit) in enumerate((('t_x', 'px'), ('t_y', 'px'), ('r_z', 'deg'))):
        known = result.row_motion[np.isfinite(result.row_motion[:, column]), column]
        if known.size:
            parts.append(f'{name} {known.min():.2f} to {known.max():.2f} {unit}')
    return 'Motion of the camera over the rows: ' + ', '.join(parts)
