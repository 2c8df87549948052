"""
Last step on top of a fitted path: follow single rows where that measures better.

Knots of a path cannot follow a vibration faster than they are. More knots follow noise, static
objects and errors of the blur as gladly, and make a good path worse. So they must earn it: columns
are dealt to two halves in stripes, a path is fitted to each and measured on the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from ._kernels.iterate import MOST_CHANGE
from .config import Config
from .level_fit import SHARP_ROWS
from .motion import Grid, still_path
from .path_estimator import PathEstimator, level_count
from .path_fit import PathFit
from .points import LiveImage, Points
from .row_signal import row_signal, second_half
from .workers import Workers

# A vibration is worth the time when shifts of rows that one half of the columns asks for explain
# this share of the misfit of the other half; below 0.01 on most frames that knots follow.
MIN_SIGNAL = 0.0125
# (knots for each knot before, share of the held-out misfit that they must take away)
DENSER = ((2, 0.03), (4, 0.15))
LEAST_MISFIT = 2.0  # grey levels; gains are measured against it where a path misfits by less
MIN_KNOT_ROWS = 4.0  # the rows that are compared are no denser
LEVELS = 2  # finest, that are fitted
ITERATIONS = 6  # at each of them
RUNS = 3  # at full and half size and once more, each of which may change the exposure
LOOSE = 1e-3  # stiffness of the start where no row holds it


class Frame(Protocol):
    """A live frame of M x N px and what a fit makes of it."""

    fit: PathFit
    predicted: np.ndarray  # (M, N) float32 [grey levels]
    residual: np.ndarray  # (M, N) float32, live - predicted [grey levels]
    judged: np.ndarray  # (M, N) bool, where the two can be compared
    complete: np.ndarray  # (M, N) bool, where the reference covers the whole exposure


AnyFrame = TypeVar('AnyFrame', bound=Frame)


class RowRefinement:
    """
    Lays denser knots through the paths of live frames where held-out columns agree.

    Parameters
    ----------
    estimator : PathEstimator
        What fitted the paths.
    grid : Grid
    config : Config
    executor : Workers
        Threads that share the work.

    """

    def __init__(
        self, estimator: PathEstimator, grid: Grid, config: Config, executor: Workers
    ) -> None:
        self._estimator = estimator
        self._executor = executor
        self._grid = grid
        self._config = config
        self._levels = min(LEVELS, level_count(grid))

    @property
    def knot_rows(self) -> float:
        """Distance of the knots of a path for a frame that shakes too much to begin with [rows]."""
        return max(MIN_KNOT_ROWS, self._config.registration.knot_rows / DENSER[0][0])

    def refined(
        self, frame: AnyFrame, live: LiveImage, build: Callable[[PathFit], AnyFrame]
    ) -> AnyFrame:
        """
        Return the frame by a path that follows its rows, or as it is.

        Parameters
        ----------
        frame : Frame
            As fitted.
        live : LiveImage
            What the fit sees of it.
        build : callable
            Makes the frame of a fit.

        """
        knot_rows, exposure = frame.fit.path.knot_rows, frame.fit.path.exposure_rows
        points: Sequence[Points] = ()
        misfit = frame.fit.cost
        blurred = frame.fit.exposure_held and exposure > knot_rows  # over what knots cannot follow
        if blurred or not np.isfinite(misfit):
            return frame
        for denser, gain in DENSER:
            if knot_rows / denser < MIN_KNOT_ROWS:
                break
            signal = row_signal(frame.predicted, frame.residual, frame.judged, self._executor)
            if signal.share < MIN_SIGNAL:
                break
            points = points or live.points(self._levels)
            start = _Start(frame.fit, knot_rows / denser, signal.shift)
            fit = self._fitted(points, start, knot_rows)
            enough = misfit - gain * max(misfit, LEAST_MISFIT)
            if fit.cost >= enough:
                continue  # not even where it was fitted
            held_out = self._held_out(points, start.like(fit))
            if held_out < enough:
                # once more: the exposure has a limited reach in a single run
                frame, misfit = build(self._run(0, points[0], fit)), held_out
        return frame

    def _fitted(self, points: Sequence[Points], start: _Start, knot_rows: float) -> PathFit:
        """Fit all columns, from each exposure that may be right."""
        fits = [self._finest(points, fit) for fit in start.fits(knot_rows)]
        return min(fits, key=lambda fit: fit.cost)

    def _held_out(self, points: Sequence[Points], start: PathFit) -> float:
        """Fit each half of the columns; return their mean misfit on the other [grey levels]."""
        misfits = []
        for half in (0, 1):
            own = [self._half(n, one, half) for n, one in enumerate(points)]
            fit = self._finest(own, start)
            other = self._half(0, points[0], 1 - half)
            misfits.append(self._estimator.level_fit(0, other, fit.path).misfits(fit))
        return float(np.concatenate(misfits).mean())

    def _half(self, n: int, points: Points, half: int) -> Points:
        """Return the points of level `n` with those of the other half switched off."""
        odd = second_half(points.columns, self._grid.live_shape[1] // 2**n)
        return points.only(odd == (half == 1))

    def _finest(self, points: Sequence[Points], fit: PathFit) -> PathFit:
        """Fit at the levels, the smallest image first."""
        for n in range(len(points) - 1, -1, -1):
            fit = self._run(n, points[n], fit)
        return fit

    def _run(self, n: int, points: Points, fit: PathFit) -> PathFit:
        level = self._estimator.level_fit(n, points, fit.path)
        return level.run(fit, not fit.exposure_held, ITERATIONS, near=True)


class _Start:
    """Paths on denser knots, laid through the rows of a fit moved by their shifts."""

    def __init__(self, fit: PathFit, knot_rows: float, shift: np.ndarray) -> None:
        """Start from `fit` on knots every `knot_rows`; `shift` (M, 2) is a `RowSignal`'s."""
        self._fit = fit
        self._knot_rows = knot_rows
        places, half = fit.path.row_centroids(), fit.path.grid.half_width
        zoom, turn = 1.0 + places[:, 3] / half, places[:, 2] / half
        cos, sin = zoom * np.cos(turn), zoom * np.sin(turn)
        places[:, 0] += cos * shift[:, 0] - sin * shift[:, 1]
        places[:, 1] += sin * shift[:, 0] + cos * shift[:, 1]
        self._places = places

    def fits(self, longest: float) -> list[PathFit]:
        """Return a start for each exposure worth trying, those that are free up to `longest`."""
        found = self._fit.path.exposure_rows
        if self._fit.exposure_held:
            return [self._with(found)]
        # an exposure that was smeared over the vibration is far too long
        others = [found] if MOST_CHANGE * SHARP_ROWS < found <= longest else []
        return [self._with(exposure) for exposure in (SHARP_ROWS, *others)]

    def like(self, fit: PathFit) -> PathFit:
        """Return the start with exposure and light of `fit`, the exposure to be kept."""
        return replace(fit, path=self._with(fit.path.exposure_rows).path, exposure_held=True)

    def _with(self, exposure: float) -> PathFit:
        old = self._fit.path
        longest = exposure * (1.0 if self._fit.exposure_held else MOST_CHANGE**RUNS) + 4.0
        path = still_path(old.grid, self._knot_rows, exposure, longest, old.bottom_up)
        basis = path.spline_basis(path.row_times)
        bend = np.diff(np.eye(basis.shape[1]), 2, axis=0)
        normal = basis.T @ basis + LOOSE * bend.T @ bend
        control = np.linalg.solve(normal, basis.T @ self._places)
        return replace(self._fit, path=replace(path, control=control))
