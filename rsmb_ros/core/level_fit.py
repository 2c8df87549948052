"""
Robust Gauss-Newton of the camera path at one size of the images.

Jacobians are kept while the path moves little: only the residuals are looked at anew.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from ._kernels.fit import correct, linearise
from ._kernels.fit_row import BIAS_SCALE, EXTRA, SPARE
from .config import Config
from .motion import Grid
from .path_fit import PathFit
from .photometric import Light
from .points import Points
from .priors import Priors
from .sampling import defocused

CHUNKS = 8  # blocks of rows, summed in this order whatever the number of threads
POINT_STEP = 1.0  # px of the level between instants of the exposure
NO_RESIDUAL = 1e8  # residuals above this mark points without reference
MIN_SIGMA = 1.0  # grey levels; no camera is quieter
OUTLIER = 30.0  # grey levels; residuals beyond count as that when fits are compared
RELINEARISE = 0.25  # px of the level the rows may move, rms, before Jacobians are worked out anew

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
SHARP_ROWS = 3.0  # exposure of a frame that is taken for sharp
DEFOCUS = (-0.3, 1.5)  # px^2, range; below 0 where the live frame is the sharper one


@dataclass(frozen=True)
class Level:
    """Reference at one size."""

    fine: np.ndarray  # (2M, 2N) half-pixel reference in linear light
    softer: np.ndarray  # (2M, 2N) what defocus of 1 px^2 (full size) adds to it
    number: int  # 0 = full size

    @property
    def factor(self) -> float:
        """Full-size pixels per pixel."""
        return 2.0**self.number


class LevelFit:
    """Fits the path of one live frame at one size, from a fit that is near."""

    def __init__(
        self, level: Level, points: Points, grid: Grid, config: Config, executor: Executor
    ) -> None:
        self._level = level
        self._points = points
        self._grid = grid
        self._config = config
        self._executor = executor
        self._dof = config.registration.degrees_of_freedom
        self._stage = min(level.number, len(ITERATIONS) - 1)
        self._at_full_size = np.clip((points.rows + 0.5) * level.factor - 0.5, 0, None)

    def run(
        self, fit: PathFit, free_exposure: bool, most: int | None = None, near: bool = False
    ) -> PathFit:
        """
        Iterate until the rows stand still, at most `most` times.

        The exposure is kept unless `free_exposure`. A fit that is `near` is not held stiff at
        first: that would undo what it knows of quick motion.
        """
        start_exposure, start_defocus = fit.path.exposure_rows, fit.defocus
        linear = _Linearised(self, fit)
        step, share, moved = np.zeros(linear.size), 1.0, np.inf
        begin = RELAXED_AFTER if near else 0
        for iteration in range(begin, begin + (most or ITERATIONS[self._stage])):
            tukey = self._stage == 0 and iteration > 0  # before that frame ends may be far off
            misplaced = _relaxed(MISPLACED[self._stage], iteration)
            if moved > RELINEARISE * self._level.factor:
                linear.renew(fit, fit.defocus - start_defocus, misplaced, tukey)
                moved = 0.0
            else:
                linear.look(fit, fit.defocus - start_defocus, misplaced, tukey)
            priors = self._priors(iteration, free_exposure, start_exposure)
            normal, gradient = priors.applied(
                linear.normal, linear.gradient, fit.path.control, fit.path.exposure_rows, fit.sigma
            )
            before, step = step, _solved(normal, gradient)
            # a step that turns back has gone too far, as weakly held ends of a frame do for ever
            share = max(0.25, 0.5 * share) if step @ before < 0 else min(1.0, 1.5 * share)
            step *= share
            row_step = linear.row_step(step)
            moved += row_step
            fit = _stepped(fit, step, linear.residuals, self._dof, start_exposure)
            if iteration >= RELAXED_AFTER and row_step < STOP_STEP[self._stage]:
                break
        own, sigma = self._own_exposure(linear, fit, iteration, start_exposure)
        return replace(
            fit,
            information=normal / fit.sigma**2,
            exposure_held=not free_exposure,
            own_exposure=own,
            own_exposure_sigma=sigma,
        )

    def misfits(self, fit: PathFit) -> np.ndarray:
        """Residuals of a fit at each point that it sees, of which `cost` is the mean."""
        linear = _Linearised(self, fit)
        linear.renew(fit, 0.0, MISPLACED[self._stage][1], True)
        seen = linear.residuals[linear.residuals < NO_RESIDUAL]
        return np.minimum(np.abs(seen), OUTLIER)

    def _own_exposure(
        self, linear: _Linearised, fit: PathFit, iteration: int, start: float
    ) -> tuple[float, float]:
        """Exposure this frame would choose, given all else it says, and its deviation [rows]."""
        priors = self._priors(iteration, True, start)
        exposure = fit.path.exposure_rows
        normal, gradient = priors.applied(
            linear.normal, linear.gradient, fit.path.control, exposure, fit.sigma
        )
        at = len(gradient) - EXTRA + 5
        unit = np.zeros((len(gradient), 2))
        unit[at, 0], unit[:, 1] = 1.0, gradient
        solution = _solved(normal, unit)
        change = np.clip(solution[at, 1], -0.5 * exposure, 0.5 * exposure)
        return float(exposure + change), float(fit.sigma * np.sqrt(max(solution[at, 0], 0.0)))

    def _priors(self, iteration: int, free_exposure: bool, exposure: float) -> Priors:
        small = self._level.number > 1  # cannot tell blur from blur, nor light across the frame
        fixed = [] if self._config.photometric.vignetting and not small else [1, 2, 3]
        fixed += [5] * (small or not free_exposure) + [6] * small
        return Priors(
            _relaxed(STIFFNESS[self._stage], iteration), tuple(fixed), exposure, self._dof
        )


class _Linearised:
    """Normal equations of a level, and what they were worked out from."""

    def __init__(self, level_fit: LevelFit, fit: PathFit) -> None:
        path, points = fit.path, level_fit._points
        self._of = level_fit
        self._fine = defocused(level_fit._level.fine, level_fit._level.softer, fit.defocus)
        self._times = np.interp(
            level_fit._at_full_size, np.arange(len(path.row_times)), path.row_times
        )
        self._basis = path.spline_basis(self._times)
        self.size = len(path.control) * level_fit._dof + EXTRA
        rows, count = points.columns.shape
        longest = int(MOST_CHANGE * path.exposure_rows / path.knot_rows) + 6
        self._jacobians = np.empty(
            (rows, longest * level_fit._dof + EXTRA + SPARE, count), np.float32
        )
        self._knots_of = np.empty((rows, 2), np.int64)
        self._edges = np.empty((rows, count), np.float32)
        self.residuals = np.empty((rows, count), np.float32)

    def renew(self, fit: PathFit, softened: float, misplaced: float, tukey: bool) -> None:
        """Sum the normal equations over all rows, in a fixed order."""
        path, level = fit.path, self._of._level
        samples = path.samples_per_row(POINT_STEP * level.factor)
        at = np.minimum(self._of._at_full_size.astype(int), len(samples) - 1)
        self._samples = samples[at]
        normal = np.zeros((CHUNKS, self.size, self.size))
        gradient = np.zeros((CHUNKS, self.size))
        data = self._data(fit, softened, misplaced, tukey)
        kept = self.residuals, self._jacobians, self._knots_of, self._edges

        def run(first: int, last: int, chunk: int) -> None:
            linearise(first, last, *data, normal[chunk], gradient[chunk], *kept)

        self._over_rows(run)
        self.normal, self.gradient = normal.sum(axis=0), gradient.sum(axis=0)

    def look(self, fit: PathFit, softened: float, misplaced: float, tukey: bool) -> None:
        """Work out residuals and gradient anew, on the Jacobians as they are."""
        gradient = np.zeros((CHUNKS, self.size))
        data = self._data(fit, softened, misplaced, tukey)
        kept = self.residuals, self._jacobians, self._knots_of, self._edges

        def run(first: int, last: int, chunk: int) -> None:
            correct(first, last, *data, gradient[chunk], *kept)

        self._over_rows(run)
        self.gradient = gradient.sum(axis=0)

    def row_step(self, step: np.ndarray) -> float:
        """Return how far a step moves the rows that are seen, root mean square [px]."""
        seen = (self.residuals < NO_RESIDUAL).mean(axis=1) > ROW_SEEN
        if not seen.any():
            return 0.0
        dof = self._of._dof
        moved = self._basis[seen] @ step[:-EXTRA].reshape(-1, dof)
        return float(np.sqrt((moved**2 @ REACH[:dof]).mean()))

    def _data(self, fit: PathFit, softened: float, misplaced: float, tukey: bool) -> tuple:
        of, path, points = self._of, fit.path, self._of._points
        return (
            self._fine.ravel(), of._level.softer.ravel(), *self._fine.shape,
            points.rows, self._times, self._samples, points.columns, points.values,
            points.inverse_depth, path.control, path.first_time, path.knot_rows,
            path.exposure_rows, softened, of._grid.focal_px, of._grid.center, of._level.factor,
            of._dof,
            np.append(fit.light.gain, fit.light.bias), of._config.camera.gamma,
            fit.sigma, misplaced, tukey,
        )  # fmt: skip

    def _over_rows(self, run) -> None:
        rows = len(self._times)
        bounds = [chunk * rows // CHUNKS for chunk in range(CHUNKS + 1)]
        list(self._of._executor.map(run, bounds[:-1], bounds[1:], range(CHUNKS)))


def _relaxed(first_and_last: tuple[float, float], iteration: int) -> float:
    first, last = first_and_last
    return float(first * (last / first) ** min(1.0, iteration / RELAXED_AFTER))


def _solved(normal: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Solve the normal equations; zero where the frame holds nothing to learn from."""
    try:
        return cho_solve(cho_factor(normal, lower=True), target)
    except LinAlgError:
        return np.zeros_like(target)


def _stepped(
    fit: PathFit, step: np.ndarray, residuals: np.ndarray, dof: int, start_exposure: float
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
    seen = np.abs(residuals[residuals < NO_RESIDUAL])
    sigma = max(MIN_SIGMA, 1.4826 * float(np.median(seen))) if seen.size else fit.sigma
    return replace(
        fit,
        path=replace(path, control=control, exposure_rows=float(exposure)),
        light=Light(fit.light.gain + extra[:4], fit.light.bias + float(BIAS_SCALE) * extra[4]),
        defocus=float(np.clip(fit.defocus + extra[6], *DEFOCUS)),
        sigma=sigma,
        cost=float(np.minimum(seen, OUTLIER).mean()) if seen.size else np.inf,
        used=seen.size / residuals.size,
    )
