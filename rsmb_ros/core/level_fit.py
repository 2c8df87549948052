"""
Robust Gauss-Newton of the camera path at one size of the images.

Jacobians are kept while the path moves little: only the residuals are looked at anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ._kernels.fit_row import AHEAD, BIAS_SCALE
from .config import Config
from .motion import Grid
from .normal_equations import (
    MOST_CHANGE,
    NO_RESIDUAL,
    OUTLIER,
    Level,
    NormalEquations,
    Residuals,
)
from .path_fit import PathFit
from .photometric import Light
from .points import Points
from .priors import Priors
from .workers import Workers
from .workspace import Workspace, Workspaces

MIN_SIGMA = 1.0  # grey levels; no camera is quieter
RELINEARISE = 0.25  # px of the level the rows may move, rms, before Jacobians are worked out anew

# Per pyramid level, full size first; the last entry serves all coarser ones.
ITERATIONS = (6, 16, 20)
STOP_STEP = (0.01, 0.04, 0.3)  # px, how far a step still moves the rows, rms
STOOD = 0.05  # px likewise, of the first step of a fit that is near: it needs no second one
# Stiffness at the first and from the fourth iteration: an object at another depth must not bend
# the path while it is far off; a shaken camera must bend it in the end.
STIFFNESS = ((0.1, 0.003), (1.0, 0.1), (1.0, 0.1))
RELAXED_AFTER = 3  # iterations
# A step after which the residuals are so much larger [grey levels] was too long: along what hardly
# changes the image, a step is as long as its outcome is uncertain.
WORSE, LITTLE_WORSE = 1.1, 0.05
SHORTER = 0.25  # share of such a step that is tried instead
# How far an edge may be off for reasons that are not the camera, first and relaxed [px]: bounds
# what a strong edge can say, so that one rich object does not outweigh the ground.
MISPLACED = ((0.5, 0.1), (0.5, 0.5), (0.5, 0.5))
EXPOSED, BLURRED = 5, 6  # which of the extra unknowns are exposure and defocus
SHARP_ROWS = 3.0  # exposure of a frame that is taken for sharp
DEFOCUS = (-0.3, 1.5)  # px^2, range; below 0 where the live frame is the sharper one


class LevelFit:
    """Fits the path of one live frame at one size, from a fit that is near."""

    def __init__(
        self,
        level: Level,
        points: Points,
        grid: Grid,
        config: Config,
        executor: Workers | None,
        workspaces: Workspaces,
    ) -> None:
        self._level = level
        self._points = points
        self._grid = grid
        self._config = config
        self._executor = executor
        self._workspaces = workspaces
        self._dof = config.registration.degrees_of_freedom
        self._stage = min(level.number, len(ITERATIONS) - 1)

    def run(
        self,
        fit: PathFit,
        free_exposure: bool,
        most: int | None = None,
        near: bool = False,
        free_defocus: bool = True,
    ) -> PathFit:
        """
        Iterate until the rows stand still, at most `most` times.

        The exposure is kept unless `free_exposure`, the defocus unless `free_defocus`. A fit that
        is `near` is not held stiff at first: that would undo what it knows of quick motion.
        """
        held = [EXPOSED] * (not free_exposure) + [BLURRED] * (not free_defocus)
        with self._workspaces.lent() as room:
            return self._iterated(self._linearised(fit, room), fit, held, most, near)

    def _iterated(
        self,
        linear: NormalEquations,
        fit: PathFit,
        held: Sequence[int],
        most: int | None,
        near: bool,
    ) -> PathFit:
        start_exposure = fit.path.exposure_rows
        step, share, moved = np.zeros_like(linear.gradient), 1.0, np.inf
        base = fit
        begin = RELAXED_AFTER if near else 0
        lens = BLURRED not in self._fixed(held)
        for iteration in range(begin, begin + (most or ITERATIONS[self._stage])):
            tukey = self._stage == 0 and iteration > 0  # before that frame ends may be far off
            misplaced = _relaxed(MISPLACED[self._stage], iteration)
            if moved > RELINEARISE * self._level.factor:
                linear.renew(fit, misplaced, tukey, lens)
                moved = 0.0
            else:
                linear.look(fit, misplaced, tukey)
            spread = linear.spread()
            if iteration > begin and spread.cost > WORSE * base.cost + LITTLE_WORSE:
                step *= SHORTER
                fit, moved = _stepped(base, step, self._dof, start_exposure), np.inf
                continue
            base = _known(fit, spread)
            priors = self._priors(iteration, held, start_exposure)
            step, share, row_step = linear.step(priors, base, fit.sigma, step, share)
            moved += row_step
            fit = _stepped(base, step, self._dof, start_exposure)
            stop = STOOD if near and iteration == begin else STOP_STEP[self._stage]
            if iteration >= RELAXED_AFTER and row_step < stop:
                break
        fit = replace(fit, exposure_held=EXPOSED in held)
        if self._level.number:
            return fit  # to be fitted at full size, which says more
        own, sigma = self._own_exposure(linear, fit, iteration, start_exposure)
        information = linear.believed.dense() / fit.sigma**2
        return replace(fit, information=information, own_exposure=own, own_exposure_sigma=sigma)

    def misfits(self, fit: PathFit) -> np.ndarray:
        """Residuals of a fit at each point that it sees, of which `cost` is the mean."""
        with self._workspaces.lent() as room:
            linear = self._linearised(fit, room)
            linear.renew(fit, MISPLACED[self._stage][1], True)
            seen = linear.residuals[linear.residuals < NO_RESIDUAL]
            return np.minimum(np.abs(seen), OUTLIER)

    def _linearised(self, fit: PathFit, room: Workspace) -> NormalEquations:
        return NormalEquations(
            self._level, self._points, self._grid, self._config, self._executor, fit, room
        )

    def _own_exposure(
        self, linear: NormalEquations, fit: PathFit, iteration: int, start: float
    ) -> tuple[float, float]:
        """Exposure this frame would choose, given all else it says, and its deviation [rows]."""
        priors = self._priors(iteration, [], start)
        exposure = fit.path.exposure_rows
        normal, gradient = priors.applied(
            linear.arrow, linear.gradient, fit.path.control, exposure, fit.sigma
        )
        at = len(gradient) - AHEAD + EXPOSED
        unit = np.zeros_like(gradient)
        unit[at] = 1.0
        variance, wanted = normal.solved(unit, gradient)
        change = min(max(wanted[at], -0.5 * exposure), 0.5 * exposure)
        return float(exposure + change), float(fit.sigma * np.sqrt(max(variance[at], 0.0)))

    def _priors(self, iteration: int, held: Sequence[int], exposure: float) -> Priors:
        """Return what is believed; extras that are `held` are known."""
        stiffness = _relaxed(STIFFNESS[self._stage], iteration)
        return Priors(stiffness, self._fixed(held), exposure, self._dof)

    def _fixed(self, held: Sequence[int]) -> tuple[int, ...]:
        """Return which extras keep their values: those `held`, and what a level is blind to."""
        small = self._level.number > 1  # cannot tell blur from blur, nor light across the frame
        fixed = [] if self._config.photometric.vignetting and not small else [1, 2, 3]
        return (*fixed, *([EXPOSED, BLURRED] if small else held))


def _relaxed(first_and_last: tuple[float, float], iteration: int) -> float:
    first, last = first_and_last
    return float(first * (last / first) ** min(1.0, iteration / RELAXED_AFTER))


def _stepped(fit: PathFit, step: np.ndarray, dof: int, start_exposure: float) -> PathFit:
    """Return a fit one step further; what is known of its residuals is that of before."""
    path = fit.path
    control = path.control.copy()
    control[:, :dof] += step[:-AHEAD].reshape(-1, dof)
    extra = step[-AHEAD:]
    # within the span that the knots cover, and no leap in one step
    change = min(max(extra[EXPOSED], -0.2 * path.exposure_rows), 0.2 * path.exposure_rows)
    exposure = min(
        max(path.exposure_rows + change, start_exposure * 0.4), start_exposure * MOST_CHANGE
    )
    return replace(
        fit,
        path=replace(path, control=control, exposure_rows=float(exposure)),
        light=Light(fit.light.gain + extra[:4], fit.light.bias + float(BIAS_SCALE) * extra[4]),
        defocus=float(min(max(fit.defocus + extra[BLURRED], DEFOCUS[0]), DEFOCUS[1])),
    )


def _known(fit: PathFit, residuals: Residuals) -> PathFit:
    """Return a fit with what is known of its residuals."""
    sigma = max(MIN_SIGMA, residuals.sigma) if residuals.used else fit.sigma
    return replace(fit, sigma=sigma, cost=residuals.cost, used=residuals.used)
