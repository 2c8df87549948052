"""
Robust Gauss-Newton of the camera path at one size of the images.

Jacobians are kept while the path moves little: only the residuals are looked at anew.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ._kernels.fit_row import AHEAD, BLURRED, EXPOSED
from ._kernels.iterate import NEVER, NO_RESIDUAL, OUTLIER, RELAXED_AFTER, Plan
from .config import Config
from .motion import Grid
from .normal_equations import Iterated, Level, NormalEquations
from .path_fit import PathFit
from .points import Points
from .priors import Priors
from .workers import Workers
from .workspace import Workspace, Workspaces

RELINEARISE = 0.25  # px of the level the rows may move, rms, before Jacobians are worked out anew

# Per pyramid level, full size first; the last entry serves all coarser ones.
ITERATIONS = (8, 16, 20)
STOP_STEP = (0.01, 0.04, 0.3)  # px, how far a step still moves the rows, rms
ENOUGH, LATE_STOP = 6, 0.05  # iterations at full size after which so much [px] counts as rest
STOOD = 0.05  # px likewise, of the first step of a fit that is near: it needs no second one
# Stiffness at the first and from the fourth iteration: an object at another depth must not bend
# the path while it is far off; a shaken camera must bend it in the end.
STIFFNESS = ((0.1, 0.003), (1.0, 0.1), (1.0, 0.1))
# How far an edge may be off for reasons that are not the camera, first and relaxed [px]: bounds
# what a strong edge can say, so that one rich object does not outweigh the ground.
MISPLACED = ((0.5, 0.1), (0.5, 0.5), (0.5, 0.5))
SHARP_ROWS = 3.0  # exposure of a frame that is taken for sharp


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
        plan = self._plan(most or ITERATIONS[self._stage], near, self._fixed(held))
        priors = self._priors(fit, held)
        with self._workspaces.lent() as room:
            iterated = self._equations(fit, room).iterated(fit, plan, priors)
            found = replace(iterated.fit, exposure_held=EXPOSED in held)
            if self._level.number:
                return found  # to be fitted at full size, which says more
            own, sigma = _own_exposure(iterated, self._priors(fit, []))
            information = iterated.believed.dense() / found.sigma**2
        return replace(found, information=information, own_exposure=own, own_exposure_sigma=sigma)

    def misfits(self, fit: PathFit) -> np.ndarray:
        """Residuals of a fit at each point that it sees, of which `cost` is the mean."""
        plan = self._plan(1, True, self._fixed([BLURRED]))
        with self._workspaces.lent() as room:
            iterated = self._equations(fit, room).iterated(fit, plan, self._priors(fit, []))
            seen = iterated.residuals[iterated.residuals < NO_RESIDUAL]
            return np.minimum(np.abs(seen), OUTLIER)

    def _equations(self, fit: PathFit, room: Workspace) -> NormalEquations:
        return NormalEquations(
            self._level, self._points, self._grid, self._config, self._executor, fit, room
        )

    def _plan(self, most: int, near: bool, fixed: Collection[int]) -> Plan:
        """Return how at most so many iterations are to go; extras that are `fixed` are known."""
        stop = STOP_STEP[self._stage]
        begin = RELAXED_AFTER if near else 0
        return Plan(
            begin=begin,
            end=begin + most,
            stiffness=STIFFNESS[self._stage],
            misplaced=MISPLACED[self._stage],
            # before that, frame ends may be far off
            tukey_from=1 if self._stage == 0 else NEVER,
            lens=BLURRED not in fixed,
            relinearise=RELINEARISE * self._level.factor,
            stop=stop,
            first_stop=STOOD if near else stop,
            late_stop=LATE_STOP,
            enough=begin + (ENOUGH if self._stage == 0 else most),
        )

    def _priors(self, fit: PathFit, held: Sequence[int]) -> Priors:
        """Return what is believed near a fit; extras that are `held` are known."""
        return Priors(self._fixed(held), fit.path.exposure_rows, self._dof)

    def _fixed(self, held: Sequence[int]) -> tuple[int, ...]:
        """Return which extras keep their values: those `held`, and what a level is blind to."""
        small = self._level.number > 1  # cannot tell blur from blur, nor light across the frame
        fixed = [] if self._config.photometric.vignetting and not small else [1, 2, 3]
        return (*fixed, *([EXPOSED, BLURRED] if small else held))


def _own_exposure(iterated: Iterated, priors: Priors) -> tuple[float, float]:
    """Return the exposure a frame would choose, all else given, and its deviation [rows]."""
    fit = iterated.fit
    exposure = fit.path.exposure_rows
    normal, gradient = priors.applied(
        iterated.arrow, iterated.gradient, iterated.stiffness, fit.path.control, exposure, fit.sigma
    )
    at = len(gradient) - AHEAD + EXPOSED
    unit = np.zeros_like(gradient)
    unit[at] = 1.0
    variance, wanted = normal.solved(unit, gradient)
    change = min(max(wanted[at], -0.5 * exposure), 0.5 * exposure)
    return float(exposure + change), float(fit.sigma * np.sqrt(max(variance[at], 0.0)))
