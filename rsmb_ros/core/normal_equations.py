"""What the points of a live frame say about its path, linearised at one size of the images."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from ._kernels.fit_row import AHEAD, BLURRED, BRIGHTEST, EXPOSED, SPARE, TONES
from ._kernels.geometry import RUN_STEP
from ._kernels.iterate import MOST_CHANGE, ORDER, Plan, Room, Scene, iterate, relaxed
from ._kernels.team import CLOSED, NEXT, new_desk
from .arrow import Arrow
from .config import Config
from .motion import Grid
from .path_fit import PathFit
from .photometric import Light
from .points import Points
from .priors import Priors
from .sampling import defocused
from .workers import Workers
from .workspace import Workspace

CHUNKS = 8  # blocks of rows, summed in this order whatever the number of threads
POINT_STEP = (1.0, 2.0)
BINS = 4096  # of the histogram that residuals' median is read from
KEPT = 2  # defocused references: a defocus between two steps is now one, now the other
DEFOCUS_STEP = 0.1  # px^2 between the defocused references that are worked out


class Level:
    """
    Reference at one size.

    Attributes
    ----------
    softer : ndarray of shape (2M, 2N), float32
        What defocus of 1 px^2 (full size) adds to it.
    number : int
        0 = full size.
    factor : float
        Full-size pixels per pixel.

    """

    def __init__(self, fine: np.ndarray, softer: np.ndarray, number: int) -> None:
        """Keep the half-pixel reference (2M, 2N) float32 in linear light."""
        self._fine = fine
        self.softer = softer
        self.number = number
        self.factor = 2.0**number
        self._defocused: list[tuple[float, np.ndarray]] = []  # of the last fits

    def defocused(
        self, variance: float, executor: Workers | None = None
    ) -> tuple[float, np.ndarray]:
        """Return the reference (2M, 2N) with about that defocus, and how much it is [px^2]."""
        near = DEFOCUS_STEP * round(variance / DEFOCUS_STEP)
        if near == 0.0:
            return near, self._fine
        for kept in self._defocused:  # frames of one camera are alike
            if kept[0] == near:
                return kept
        made = near, defocused(self._fine, self.softer, near, executor)
        self._defocused = [made, *self._defocused[: KEPT - 1]]
        return made


@dataclass(frozen=True)
class Iterated:
    """Outcome of the iterations."""

    fit: PathFit
    steps: int  # iterations it took
    stiffness: float  # of the last one
    arrow: Arrow  # normal equations where the last step was taken
    believed: Arrow  # ... together with what was believed of it
    gradient: np.ndarray  # (D + AHEAD,) path first, then the extras
    residuals: np.ndarray  # (R, P) float32 of the last look, above `NO_RESIDUAL` where is none


class NormalEquations:
    """Normal equations of one live frame at one size, and their room."""

    def __init__(
        self,
        level: Level,
        points: Points,
        grid: Grid,
        config: Config,
        executor: Workers | None,
        fit: PathFit,
        room: Workspace,
    ) -> None:
        """Prepare those of fits on the knots of `fit`, whose exposure may change by so much."""
        path = fit.path
        dof = config.registration.degrees_of_freedom
        self._executor = executor
        self._dof = dof
        self._step_px = point_step(level.number)
        start_defocus, fine = level.defocused(fit.defocus, executor)
        last = grid.live_shape[0] - 1
        at_full_size = np.clip((points.rows + 0.5) * level.factor - 0.5, 0, last)
        times = last - at_full_size if path.bottom_up else at_full_size
        rows, count = points.columns.shape
        gamma = config.camera.gamma
        self._scene = Scene(
            np.arange(CHUNKS + 1) * rows // CHUNKS, fine.ravel(), level.softer.ravel(),
            fine.shape[0], fine.shape[1], points.rows, times,
            path.row_times[at_full_size.astype(np.int64)], last + 1,
            points.from_center(level.factor, grid), points.values, points.inverse_depth,
            path.first_time, path.knot_rows, start_defocus, grid.focal_px, grid.center,
            level.factor, dof, tone_table(gamma), gamma,
        )  # fmt: skip
        longest = MOST_CHANGE * path.exposure_rows
        most = int(longest / path.knot_rows) + 6
        spread_rows = rows // CHUNKS + 1
        pitch = abs(times[-1] - times[0]) / max(1, rows - 1)
        size = int((longest + spread_rows * pitch) / path.knot_rows) + 7
        side = size * dof + AHEAD + SPARE
        unknowns = len(path.control) * dof
        self._room = Room(
            np.zeros(CHUNKS, np.int64),
            room.array('normals', (CHUNKS, side, side)),
            room.array('gradients', (CHUNKS, side)),
            room.array('residuals', (rows, count), np.float32),
            room.array('jacobians', (rows, most * dof + AHEAD + SPARE, count), np.float32),
            room.array('knots', (rows, 2), np.int64),
            room.array('edges', (rows, count), np.float32),
            room.array('soft', (rows, count), np.float32),
            room.array('samples', (rows,), np.int64),
            room.array('runs', (rows,)),
            room.array('along', (math.ceil((last + 1 + longest) / RUN_STEP) + 2,)),
            room.array('bins', (BINS,), np.int64),
            np.zeros(rows, bool),
            np.zeros(ORDER),
            room.array('bands', (3, unknowns * most * dof)),
            room.array('borders', (3, unknowns, AHEAD)),
            room.array('corners', (3, AHEAD, AHEAD)),
            room.array('steps', (3, unknowns + AHEAD)),
        )

    def iterated(self, fit: PathFit, plan: Plan, priors: Priors) -> Iterated:
        """Iterate from `fit` as planned; what is returned lasts until the room is lent again."""
        path, light, executor = fit.path, fit.light, self._executor
        control = path.control.copy()
        extras = np.zeros(AHEAD)
        extras[:4], extras[4] = light.gain, light.bias
        extras[EXPOSED], extras[BLURRED] = path.exposure_rows, fit.defocus
        desk = new_desk()
        data = (
            desk, self._scene, self._room, plan, priors.on(len(control)), self._step_px,
            fit.sigma, control, extras, control.copy(), extras.copy(),
        )  # fmt: skip
        others = partial(iterate, False, *data)
        try:
            asked = [executor.ask(others) for _ in range(executor.helpers)] if executor else []
            sigma, cost, used, iteration, width = iterate(True, *data)
        finally:
            desk[NEXT] = CLOSED  # whatever happens here, nobody waits for ever
        for helper in asked:
            helper.result()
        found = replace(
            fit,
            path=replace(path, control=control, exposure_rows=float(extras[EXPOSED])),
            light=Light(extras[:4].copy(), float(extras[4])),
            defocus=float(extras[BLURRED]),
            sigma=sigma,
            cost=cost,
            used=used,
        )
        unknowns = len(control) * self._dof
        arrow, believed = (
            Arrow(
                self._room.bands[n, : unknowns * width].reshape(unknowns, width),
                self._room.borders[n],
                self._room.corners[n],
            )
            for n in (0, 1)
        )
        return Iterated(
            fit=found,
            steps=iteration + 1 - plan.begin,
            stiffness=relaxed(plan.stiffness, iteration),
            arrow=arrow,
            believed=believed,
            gradient=self._room.steps[0],
            residuals=self._room.residuals,
        )


def point_step(level: int) -> float:
    """Return how far the reference moves between instants of the exposure at a level [px]."""
    return POINT_STEP[min(level, len(POINT_STEP) - 1)] * 2.0**level


@cache
def tone_table(gamma: float) -> np.ndarray:
    """
    Return display values (n,) float32 at equal steps of the root of linear light.

    Over the root the tone curve is nearly straight: read linearly it is right to 3e-3 grey levels.
    """
    root = np.arange(round(float(BRIGHTEST) ** 0.5 * float(TONES)) + 3) / float(TONES)
    return (255.0 * (root**2 / 255.0) ** (1.0 / gamma)).astype(np.float32)
