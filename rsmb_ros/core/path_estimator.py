"""
Path estimator: one continuous camera path fitted to the whole frame, not rows on their own.

Robust Gauss-Newton over a pyramid on the strongest gradients of the live image; unknowns are
the control points of the path, the light, and the exposure when it is not given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from ._kernels.fit import BIAS_SCALE, EXTRA, accumulate
from .coarse import StripMatches, start_path
from .config import Config
from .motion import CameraPath, Grid, still_path
from .photometric import Light, to_display
from .points import Points, select_points
from .priors import Priors
from .sampling import half_pixel, pyramid

COARSEST_WIDTH = 160  # px; the pyramid ends there
CHUNKS = 8  # blocks of rows, summed in this order whatever the number of threads
POINT_STEP = 1.0  # px of the level between instants of the exposure
NO_RESIDUAL = 1e8  # residuals above this mark points without reference
MIN_SIGMA = 1.0  # grey levels; no camera is quieter

# Per pyramid level, full size first; the last entry serves all coarser ones.
ITERATIONS = (8, 16, 20)
STOP_STEP = (0.01, 0.04, 0.15)  # px, how far a step still moves the rows, rms
ROW_SEEN = 0.2  # share of a row's points that must lie in the reference for it to be waited for
# Stiffness at the first and from the fourth iteration: an object at another depth must not bend
# the path while it is far off; a shaken camera must bend it in the end.
STIFFNESS = ((0.1, 0.003), (1.0, 0.1), (1.0, 0.1))
RELAXED_AFTER = 3  # iterations
# How far an edge may be off for reasons that are not the camera, first and relaxed [px]: bounds
# what a strong edge can say, so that one rich object does not outweigh the ground.
MISPLACED = ((0.5, 0.1), (0.5, 0.5), (0.5, 0.5))
# Mean square of what 1 px of each path coordinate moves the pixels of a 4:3 frame [px^2].
REACH = np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.2])
MOST_CHANGE = 1.6  # of the exposure while one image size is fitted
COLD_EXPOSURES = (3.0, 12.0, 36.0, 90.0, 200.0)  # rows, tried when nothing is known
TRIAL = 4  # iterations each of them gets at half size
FINALISTS = 2  # of them that are fitted until they stand


@dataclass(frozen=True)
class PathFit:
    """Outcome of the estimation."""

    path: CameraPath
    light: Light
    sigma: float  # robust standard deviation of the residual [grey levels]
    cost: float  # mean truncated residual [grey levels]; compares starts
    information: np.ndarray  # (D, D) inverse covariance of control points and extras [1/px^2]
    used: float  # share of the points that lie in the reference, 0..1


def row_uncertainty(fit: PathFit) -> np.ndarray:
    """Standard deviation of each row's place at mid-exposure (M,) [px], from the Hessian."""
    path = fit.path
    knots = len(path.control)
    dof = (len(fit.information) - EXTRA) // knots
    try:
        factor = cho_factor(fit.information, lower=True)
    except LinAlgError:
        return np.full(len(path.row_times), np.inf)
    basis = path.spline_basis(path.row_times)
    variance = np.zeros(len(basis))
    for e in (0, 1):
        place = np.zeros((len(fit.information), len(basis)))
        place[e : knots * dof : dof] = basis.T
        variance += np.einsum('kt,kt->t', place, cho_solve(factor, place))
    return np.sqrt(variance)


@dataclass(frozen=True)
class _Level:
    """Reference at one size."""

    fine: np.ndarray  # half-pixel reference in linear light, flat
    shape: tuple[int, int]  # of the half-pixel reference
    factor: float  # full-size pixels per pixel


class PathEstimator:
    """Fits camera paths of live frames of one size to one reference."""

    def __init__(
        self, reference: np.ndarray, grid: Grid, config: Config, executor: Executor
    ) -> None:
        """Prepare `reference`, (M, N) float32 in linear light."""
        self._grid = grid
        self._config = config
        self._executor = executor
        smaller = min(grid.live_shape[1], grid.reference_shape[1])
        count = max(1, 1 + round(np.log2(max(1.0, smaller / COARSEST_WIDTH))))
        self._levels = []
        for n, image in enumerate(pyramid(reference, count)):
            fine = half_pixel(image)
            self._levels.append(_Level(fine.ravel(), fine.shape, 2.0**n))

    def estimate(
        self, live: np.ndarray, matches: StripMatches, exposure: float | None = None
    ) -> PathFit:
        """
        Fit the path of `live`, (M, N) float32 in linear light, from the coarse matches.

        `exposure` [rows], where given, is kept; otherwise the configuration's, or calibrated.

        Never raises on image content: a hopeless frame ends with a large `cost`.
        """
        gamma = self._config.camera.gamma
        points = [
            select_points(to_display(image, gamma), n)
            for n, image in enumerate(pyramid(live, len(self._levels)))
        ]
        given = exposure or self._config.shutter.exposure_rows
        if given > 0:
            fit = self._fit_levels(points, self._start(matches, given), 0, free_exposure=False)
        else:
            fit = self._self_calibrated(points, matches)
        return fit

    def refine(self, live: np.ndarray, fit: PathFit, foreground: np.ndarray) -> PathFit:
        """
        Fit the path of `live` again from `fit`, without what is known not to be background.

        `foreground` (M, N) bool marks pixels of static objects at other depths: in rows that they
        dominate, the path had followed them.
        """
        gamma = self._config.camera.gamma
        finest = min(1, len(self._levels) - 1)
        masks = pyramid(foreground.astype(np.float32), finest + 1)
        points = [
            select_points(to_display(image, gamma), n).without(mask > 0)
            for n, (image, mask) in enumerate(zip(pyramid(live, finest + 1), masks, strict=True))
        ]
        return self._fit_levels(points, fit, 0, self._config.shutter.exposure_rows == 0)

    def _start(self, matches: StripMatches, exposure: float) -> PathFit:
        bottom_up = self._config.shutter.readout == 'bottom_up'
        knot_rows = self._config.registration.knot_rows
        longest = _longest(exposure)
        path = start_path(matches, self._grid, knot_rows, exposure, longest, bottom_up)
        return PathFit(path, Light.same(), 12.0, np.inf, np.zeros((0, 0)), 0.0)

    def _self_calibrated(self, points: Sequence[Points], matches: StripMatches) -> PathFit:
        """
        Try several exposures and finish with the one that fits best.

        The smallest image cannot tell them apart and is fitted once; at half size all are tried
        for a few iterations, the best of them until they stand.
        """
        finest = min(1, len(self._levels) - 1)
        tried = [e for e in COLD_EXPOSURES if e <= 0.8 * self._grid.live_shape[0]]
        middle = tried[len(tried) // 2]
        start = self._fit_levels(points, self._start(matches, middle), finest + 1, False)
        fits = [
            self._fit_level(finest, points[finest], _with_exposure(start, exposure), True, TRIAL)
            for exposure in tried
        ]
        fits = sorted(fits, key=lambda fit: fit.cost)[:FINALISTS]
        fits = [self._fit_level(finest, points[finest], fit, True) for fit in fits]
        best = min(fits, key=lambda fit: fit.cost)
        return self._fit_levels(points[:finest], best, 0, True)

    def _fit_levels(
        self, points: Sequence[Points], fit: PathFit, finest: int, free_exposure: bool
    ) -> PathFit:
        for n in range(len(points) - 1, finest - 1, -1):
            # a small image cannot tell exposures apart
            fit = self._fit_level(n, points[n], fit, free_exposure and n <= 1)
        return fit

    def _fit_level(
        self, n: int, points: Points, fit: PathFit, free_exposure: bool, most: int | None = None
    ) -> PathFit:
        stage = min(n, len(ITERATIONS) - 1)
        start_exposure = fit.path.exposure_rows
        step, share = np.zeros(fit.path.control.shape[0] * self._dof + EXTRA), 1.0
        for iteration in range(most or ITERATIONS[stage]):
            tukey = n == 0 and iteration > 0  # before that the ends of a frame may be far off
            first, last = MISPLACED[stage]
            misplaced = first * (last / first) ** min(1.0, iteration / RELAXED_AFTER)
            system = self._linearise(n, points, fit, misplaced, tukey)
            priors = self._priors(n, iteration, free_exposure, start_exposure)
            normal, gradient = priors.applied(
                system.normal,
                system.gradient,
                fit.path.control,
                fit.path.exposure_rows,
                fit.sigma,
            )
            before, step = step, _step(normal, gradient)
            # a step that turns back has gone too far, as weakly held ends of a frame do for ever
            share = max(0.25, 0.5 * share) if step @ before < 0 else min(1.0, 1.5 * share)
            step *= share
            fit = _stepped(fit, step, system, self._dof, start_exposure)
            if (
                iteration >= RELAXED_AFTER
                and self._row_step(fit.path, system, step) < STOP_STEP[stage]
            ):
                break
        return replace(fit, information=normal / fit.sigma**2)

    def _row_step(self, path: CameraPath, system: _System, step: np.ndarray) -> float:
        """Return how far a step moves the rows that are seen, root mean square [px]."""
        seen = (system.misfit < NO_RESIDUAL).mean(axis=1) > ROW_SEEN
        if not seen.any():
            return 0.0
        moved = path.spline_basis(system.times[seen]) @ step[:-EXTRA].reshape(-1, self._dof)
        return float(np.sqrt((moved**2 @ REACH[: self._dof]).mean()))

    @property
    def _dof(self) -> int:
        return self._config.registration.degrees_of_freedom

    def _linearise(
        self, n: int, points: Points, fit: PathFit, misplaced: float, tukey: bool
    ) -> _System:
        """Sum the normal equations over all rows, in a fixed order."""
        level, path = self._levels[n], fit.path
        size = len(path.control) * self._dof + EXTRA
        normal = np.zeros((CHUNKS, size, size))
        gradient = np.zeros((CHUNKS, size))
        residuals = np.empty(points.values.shape, np.float32)
        at_full_size = np.clip((points.rows + 0.5) * level.factor - 0.5, 0, None)
        times = np.interp(at_full_size, np.arange(len(path.row_times)), path.row_times)
        samples = path.samples_per_row(POINT_STEP * level.factor)
        samples = samples[np.minimum(at_full_size.astype(int), len(samples) - 1)]
        light = np.append(fit.light.gain, fit.light.bias)

        def run(chunk: int) -> None:
            rows = len(points.rows)
            accumulate(
                chunk * rows // CHUNKS, (chunk + 1) * rows // CHUNKS, level.fine, *level.shape,
                points.rows, times, samples, points.columns, points.values, path.control,
                path.first_time, path.knot_rows, path.exposure_rows, self._grid.focal_px,
                self._grid.center, level.factor, self._dof, light, self._config.camera.gamma,
                fit.sigma, misplaced, tukey, normal[chunk], gradient[chunk], residuals,
            )  # fmt: skip

        _run_all(self._executor, run, CHUNKS)
        return _System(normal.sum(axis=0), gradient.sum(axis=0), np.abs(residuals), times)

    def _priors(self, n: int, iteration: int, free_exposure: bool, exposure: float) -> Priors:
        first, last = STIFFNESS[min(n, len(STIFFNESS) - 1)]
        stiffness = first * (last / first) ** min(1.0, iteration / RELAXED_AFTER)
        light = self._config.photometric
        fixed = [] if light.vignetting and n <= 1 else [1, 2, 3]
        if not free_exposure:
            fixed.append(5)
        return Priors(stiffness, tuple(fixed), exposure, self._dof)


def _longest(exposure: float) -> float:
    """Longest exposure the knots of a path must cover when it starts from `exposure` [rows]."""
    return MOST_CHANGE * exposure + 4.0


def _with_exposure(fit: PathFit, exposure: float) -> PathFit:
    """Return the fit with another exposure, its path on knots that cover that one."""
    old = fit.path
    new = still_path(old.grid, old.knot_rows, exposure, _longest(exposure), old.bottom_up)
    knots = new.first_time + new.knot_rows * np.arange(0.0, len(new.control) - 2.5, 0.5)
    basis = new.spline_basis(knots)
    control, *_ = np.linalg.lstsq(basis, old.coordinates(knots), rcond=None)
    return replace(fit, path=replace(new, control=control))


@dataclass(frozen=True)
class _System:
    """Normal equations at one linearisation."""

    normal: np.ndarray  # (D, D), lower triangle
    gradient: np.ndarray  # (D,)
    misfit: np.ndarray  # (R, P) absolute residuals [grey levels]
    times: np.ndarray  # (R,) of the rows of points [rows]


def _step(normal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Solve for the Gauss-Newton step; zero where the frame holds nothing to learn from."""
    try:
        return cho_solve(cho_factor(normal, lower=True), gradient)
    except LinAlgError:
        return np.zeros(len(gradient))


def _stepped(
    fit: PathFit,
    step: np.ndarray,
    system: _System,
    dof: int,
    start_exposure: float,
) -> PathFit:
    path = fit.path
    control = path.control.copy()
    control[:, :dof] += step[:-EXTRA].reshape(-1, dof)
    extra = step[-EXTRA:]
    # within the span that the knots cover, and no leap in one step
    change = np.clip(extra[5], -0.2 * path.exposure_rows, 0.2 * path.exposure_rows)
    exposure = np.clip(
        path.exposure_rows + change, start_exposure * 0.4, start_exposure * MOST_CHANGE
    )
    seen = system.misfit[system.misfit < NO_RESIDUAL]
    sigma = max(MIN_SIGMA, 1.4826 * float(np.median(seen))) if seen.size else fit.sigma
    return PathFit(
        path=replace(path, control=control, exposure_rows=float(exposure)),
        light=Light(fit.light.gain + extra[:4], fit.light.bias + float(BIAS_SCALE) * extra[4]),
        sigma=sigma,
        cost=float(np.minimum(seen, 30.0).mean()) if seen.size else np.inf,
        information=fit.information,
        used=seen.size / system.misfit.size,
    )


def _run_all(executor: Executor, task: Callable[[int], None], count: int) -> None:
    list(executor.map(task, range(count)))
