"""
Fit a path outwards from the rows that fit, where the start has lost the others.

A camera that turns within some dozen rows shears and blurs bands that the coarse search matches as
rigid pieces, and from where these put it Gauss-Newton does not find back. Next to rows that fit,
though, the path cannot be far off: it goes on as fast as it came, or turns by as much as one of a
few bends. The bends that explain the next rows best are fitted, the best of them goes on from
there: as the report sweeps its rows, but with their blur.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from .agreement import MIN_BLOCKS, Agreement
from .motion import CameraPath
from .path_estimator import PathEstimator
from .path_fit import PathFit
from .points import LiveImage, Points
from .workers import Workers, each

AGREES = 0.6  # share of the blocks that agree from which on a band of rows is held, ...
LOST = 0.3  # ... and below which it is lost
# Lengths in px of the size that is swept at, half of the full one at 640 px.
STEP = 12  # rows that are taken in at a time
INSET = 8  # rows between those that do not agree and those that are held
BEND = 4.0  # between bends that are tried: how far the end of a step lies from straight on, ...
REACH = 3  # ... so many to each side
FINALISTS = 3  # bends that are fitted
ITERATIONS = 6  # of each of these fits
LAZY = 0.02  # share of the misfit that a bend must take away for each `BEND`
LEAST_SEEN = 0.3  # share of the new points that a bend must let see
UNSEEN = 1e3  # grey levels, misfit of those that do not
STIFF = 0.01  # of a path where no row holds it

_BENDS = sorted(
    ((BEND * x, BEND * y) for x in range(-REACH, REACH + 1) for y in range(-REACH, REACH + 1)),
    key=lambda bend: np.hypot(*bend),
)
_LAZY = np.array([1.0 + LAZY * np.hypot(*bend) / BEND for bend in _BENDS])


def level_of(estimator: PathEstimator) -> int:
    """Return the size of the images that is swept at: the second smallest tells bends apart."""
    return max(0, estimator.levels - 2)


def held_rows(found: Agreement, rows: int, n: int) -> tuple[int, int] | None:
    """
    Return first and last row (exclusive) of those to sweep from; None where there is no need to.

    Parameters
    ----------
    found : Agreement
        Of the frame as fitted.
    rows : int
        Of the frame.
    n : int
        Size of the images that is swept at.

    """
    asked, agreed = found.asked.sum(axis=1), found.agreed.sum(axis=1)
    known = asked >= MIN_BLOCKS
    if not (known & (agreed < LOST * asked)).any():
        return None
    held = np.concatenate([[False], known & (agreed >= AGREES * asked), [False]])
    edges = np.flatnonzero(held[1:] != held[:-1]).reshape(-1, 2)
    if not edges.size:
        return None
    begin, end = edges[np.diff(edges)[:, 0].argmax()]
    inset = round(INSET * 2.0**n)
    first = begin * found.size + (inset if begin else 0)
    last = rows if end == len(asked) else end * found.size - inset
    return (int(first), int(last)) if last - first >= STEP * 2.0**n else None


def swept(
    fit: PathFit,
    live: LiveImage,
    estimator: PathEstimator,
    held: tuple[int, int],
    executor: Workers,
) -> PathFit:
    """
    Fit the path of `live` again, from the rows that are `held` (first, last) to its ends.

    Parameters
    ----------
    fit : PathFit
        Right in these rows.
    live : LiveImage
    estimator : PathEstimator
        What fitted it.
    held : tuple of int
        See `held_rows`.
    executor : Workers
        Threads that share the work.

    """
    n = level_of(estimator)
    sweep = _Sweep(live.points(estimator.levels), estimator, n, executor)
    free, fit = not fit.exposure_held, replace(fit, lost=None)
    for known, end in _steps(held, len(live.grey), round(STEP * 2.0**n)):
        fit = sweep.further(fit, known, end)
    for level, points in reversed(list(enumerate(live.points(n + 1)))):
        whole = estimator.level_fit(level, points, fit.path)
        fit = whole.run(fit, free, near=True)
    return fit


def _steps(held: tuple[int, int], rows: int, step: int) -> Iterator[tuple[tuple[int, int], int]]:
    """Yield which rows (first, last) are known in turn, and to which end they are to grow."""
    first, last = held
    while first > 0 or last < rows:
        for end in (max(0, first - step), min(rows, last + step)):
            if first <= end <= last:
                continue
            yield (first, last), end
            first, last = min(first, end), max(last, end)


class _Sweep:
    """Takes a path over more and more rows of the `points` at all sizes, by those of size `n`."""

    def __init__(
        self, points: Sequence[Points], estimator: PathEstimator, n: int, executor: Workers
    ) -> None:
        self._points = points
        self._estimator = estimator
        self._n = n
        self._executor = executor

    def further(self, fit: PathFit, known: tuple[int, int], end: int) -> PathFit:
        """Fit the path of the rows that are `known` (first, last) as far as row `end`, too."""
        first, last = known
        down = end > last
        row, new = (last, (last, end)) if down else (first, (end, first))
        points = self._points[self._n].between(*new, self._n)
        if not points.rows.size:
            return fit
        ahead = replace(fit, path=_straight_on(fit.path, known))
        level = self._estimator.level_fit(self._n, points, ahead.path, shared=False)

        def misfit(fit: PathFit) -> float:
            seen = level.misfits(fit)
            return float(seen.mean()) if seen.size > LEAST_SEEN * points.columns.size else UNSEEN

        turned = [self._turned(ahead, bend, row, down) for bend in _BENDS]
        misfits = np.array(each(self._executor, misfit, turned))
        best = [turned[k] for k in np.argsort(misfits * _LAZY, kind='stable')[:FINALISTS]]
        rows = min(first, end), max(last, end)
        return min(each(self._executor, partial(self._fitted, rows), best), key=misfit)

    def _fitted(self, rows: tuple[int, int], fit: PathFit) -> PathFit:
        """Fit some `rows` (first, last), the smallest images first."""
        for n in range(len(self._points) - 1, self._n - 1, -1):
            points = self._points[n].between(*rows, n)
            level = self._estimator.level_fit(n, points, fit.path, shared=False)
            fit = level.run(fit, False, ITERATIONS, near=True)
        return fit

    def _turned(self, fit: PathFit, bend: tuple[float, float], row: int, down: bool) -> PathFit:
        """Return the fit with a path that turns at a `row`, by `bend` x, y after a step."""
        path, factor = fit.path, 2.0**self._n
        knots = path.first_time + path.knot_rows * (np.arange(len(path.control)) - 1.0)
        rows = len(path.row_times)
        at = rows - 1 - row if path.bottom_up else row
        onwards = 1.0 if down != path.bottom_up else -1.0
        steps = np.maximum(0.0, onwards * (knots - at) / (STEP * factor))
        control = path.control.copy()
        control[:, :2] += steps[:, None] * np.multiply(bend, factor)
        return replace(fit, path=replace(path, control=control))


def _straight_on(path: CameraPath, known: tuple[int, int]) -> CameraPath:
    """Return the path that goes on as it leaves the rows `known` (first, last)."""
    basis = path.spline_basis(path.row_times[slice(*known)])
    held = basis.T @ basis
    control = path.control.copy()
    # the offset keeps its speed, all else its value
    for part, order in ((np.s_[:2], 2), (np.s_[2:], 1)):
        change = np.diff(np.eye(len(control)), order, axis=0)
        normal = held + STIFF * change.T @ change
        control[:, part] = np.linalg.solve(normal, held @ path.control[:, part])
    return replace(path, control=control)
