"""What the points of a live frame say about its path, linearised at one size of the images."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from ._kernels.fit import correct, linearise
from ._kernels.fit_row import EXTRA, SPARE
from .config import Config
from .motion import Grid
from .path_fit import PathFit
from .points import Points
from .sampling import defocused

CHUNKS = 8  # blocks of rows, summed in this order whatever the number of threads
POINT_STEP = 1.0  # px of the level between instants of the exposure
NO_RESIDUAL = 1e8  # residuals above this mark points without reference
ROW_SEEN = 0.2  # share of a row's points that must lie in the reference for it to be waited for
MOST_CHANGE = 1.6  # of the exposure while one image size is fitted
# Mean square of what 1 px of each path coordinate moves the pixels of a 4:3 frame [px^2].
REACH = np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.2])


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


class NormalEquations:
    """
    Normal equations of one live frame at one size, linearised near a fit.

    Attributes
    ----------
    size : int
        D, unknowns: control points, then `EXTRA` others.
    normal : ndarray of shape (D, D)
        Lower triangle.
    gradient : ndarray of shape (D,)
    residuals : ndarray of shape (R, P), float32
        live - predicted at each point [grey levels], above `NO_RESIDUAL` where there is none.

    """

    def __init__(
        self,
        level: Level,
        points: Points,
        grid: Grid,
        config: Config,
        executor: Executor,
        fit: PathFit,
    ) -> None:
        path = fit.path
        self._level = level
        self._points = points
        self._grid = grid
        self._gamma = config.camera.gamma
        self._executor = executor
        self._dof = config.registration.degrees_of_freedom
        self._start_defocus = fit.defocus
        self._fine = defocused(level.fine, level.softer, fit.defocus)
        self._at_full_size = np.clip((points.rows + 0.5) * level.factor - 0.5, 0, None)
        self._times = np.interp(self._at_full_size, np.arange(len(path.row_times)), path.row_times)
        self._basis = path.spline_basis(self._times)
        self.size = len(path.control) * self._dof + EXTRA
        rows, count = points.columns.shape
        longest = int(MOST_CHANGE * path.exposure_rows / path.knot_rows) + 6
        self._jacobians = np.empty((rows, longest * self._dof + EXTRA + SPARE, count), np.float32)
        self._knots_of = np.empty((rows, 2), np.int64)
        self._edges = np.empty((rows, count), np.float32)
        self.residuals = np.empty((rows, count), np.float32)

    def renew(self, fit: PathFit, misplaced: float, tukey: bool) -> None:
        """
        Sum the normal equations over all rows, in a fixed order.

        `misplaced` [px] is how far an edge may be off, `tukey` chooses the loss (else Huber).
        """
        samples = fit.path.samples_per_row(POINT_STEP * self._level.factor)
        at = np.minimum(self._at_full_size.astype(int), len(samples) - 1)
        self._samples = samples[at]
        normal = np.zeros((CHUNKS, self.size, self.size))
        gradient = np.zeros((CHUNKS, self.size))
        data = self._data(fit, misplaced, tukey)
        kept = self.residuals, self._jacobians, self._knots_of, self._edges

        def run(first: int, last: int, chunk: int) -> None:
            linearise(first, last, *data, normal[chunk], gradient[chunk], *kept)

        self._over_rows(run)
        self.normal, self.gradient = normal.sum(axis=0), gradient.sum(axis=0)

    def look(self, fit: PathFit, misplaced: float, tukey: bool) -> None:
        """Work out residuals and gradient anew, on the Jacobians as they are."""
        gradient = np.zeros((CHUNKS, self.size))
        data = self._data(fit, misplaced, tukey)
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
        moved = self._basis[seen] @ step[:-EXTRA].reshape(-1, self._dof)
        return float(np.sqrt((moved**2 @ REACH[: self._dof]).mean()))

    def _data(self, fit: PathFit, misplaced: float, tukey: bool) -> tuple:
        path, level, points = fit.path, self._level, self._points
        softened = fit.defocus - self._start_defocus
        return (
            self._fine.ravel(), level.softer.ravel(), *self._fine.shape,
            points.rows, self._times, self._samples, points.columns, points.values,
            points.inverse_depth, path.control, path.first_time, path.knot_rows,
            path.exposure_rows, softened, self._grid.focal_px, self._grid.center, level.factor,
            self._dof, np.append(fit.light.gain, fit.light.bias), self._gamma, fit.sigma,
            misplaced, tukey,
        )  # fmt: skip

    def _over_rows(self, run: Callable[[int, int, int], None]) -> None:
        rows = len(self._times)
        bounds = [chunk * rows // CHUNKS for chunk in range(CHUNKS + 1)]
        list(self._executor.map(run, bounds[:-1], bounds[1:], range(CHUNKS)))
