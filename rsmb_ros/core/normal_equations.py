"""What the points of a live frame say about its path, linearised at one size of the images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from ._kernels.fit import correct, linearise
from ._kernels.fit_row import AHEAD, BRIGHTEST, SPARE, TONES
from ._kernels.normal import assemble, assemble_gradient, next_step
from ._kernels.residuals import spread
from .arrow import Arrow
from .config import Config
from .motion import Grid
from .path_fit import PathFit
from .points import Points
from .priors import Priors
from .sampling import defocused
from .workers import SMALL, Workers, shared
from .workspace import Workspace

CHUNKS = 8  # blocks of rows, summed in this order whatever the number of threads
SHARES = 4  # of the chunks, that threads take: calling a kernel with so much takes its time
ALONE = 4_000  # points times instants, below which a second thread takes longer to ask
POINT_STEP = (1.0, 2.0)  # px of the level between instants, full size and smaller
NO_RESIDUAL = 1e8  # residuals above this mark points without reference
OUTLIER = 30.0  # grey levels; residuals beyond count as that when fits are compared
BINS_PER_LEVEL = 16.0  # of the histogram that residuals' median is read from
BINS = 4096
ROW_SEEN = 0.2  # share of a row's points that must lie in the reference for it to be waited for
MOST_CHANGE = 1.6  # of the exposure while one image size is fitted
# Mean square of what 1 px of each path coordinate moves the pixels of a 4:3 frame [px^2].
REACH = np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.2])
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
        self._defocused: tuple[float, np.ndarray] = (0.0, fine)

    def defocused(
        self, variance: float, executor: Workers | None = None
    ) -> tuple[float, np.ndarray]:
        """Return the reference (2M, 2N) with about that defocus, and how much it is [px^2]."""
        near = DEFOCUS_STEP * round(variance / DEFOCUS_STEP)
        kept = self._defocused  # of the last fit: frames of one camera are alike
        if near == 0.0:
            return near, self._fine
        if kept[0] != near:
            kept = self._defocused = (near, defocused(self._fine, self.softer, near, executor))
        return kept


@dataclass(frozen=True)
class Residuals:
    """How well a fit explains the points."""

    sigma: float  # robust standard deviation [grey levels], 0 without any
    cost: float  # mean, each at most `OUTLIER` [grey levels], infinite without any
    used: float  # share of the points that lie in the reference, 0..1


class NormalEquations:
    """
    Normal equations of one live frame at one size, linearised near a fit.

    Attributes
    ----------
    arrow : Arrow
        The matrix.
    believed : Arrow
        The matrix with the priors of the last `step`.
    gradient : ndarray of shape (D + AHEAD,)
        Path first, then the extras.
    residuals : ndarray of shape (R, P), float32
        live - predicted at each point [grey levels], above `NO_RESIDUAL` where there is none.

    """

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
        path = fit.path
        self._level = level
        self._gamma = config.camera.gamma
        self._tones = tone_table(self._gamma)
        self._executor = executor
        self._dof = config.registration.degrees_of_freedom
        self._knots = len(path.control)
        self._start_defocus, fine = level.defocused(fit.defocus, executor)
        last = grid.live_shape[0] - 1
        self._at_full_size = np.clip((points.rows + 0.5) * level.factor - 0.5, 0, last)
        self._times = last - self._at_full_size if path.bottom_up else self._at_full_size
        rows, count = points.columns.shape
        # what the kernels take that stays, in their order
        self._images = (
            np.arange(CHUNKS + 1) * rows // CHUNKS, fine.ravel(), level.softer.ravel(),
            *fine.shape, points.rows, self._times,
        )  # fmt: skip
        self._where = points.from_center(level.factor, grid), points.values, points.inverse_depth
        self._camera = grid.focal_px, grid.center, level.factor, self._dof
        longest = MOST_CHANGE * path.exposure_rows
        most = int(longest / path.knot_rows) + 6
        spread_rows = rows // CHUNKS + 1
        pitch = abs(self._times[-1] - self._times[0]) / max(1, rows - 1)
        size = int((longest + spread_rows * pitch) / path.knot_rows) + 7
        self._begins = np.zeros(CHUNKS, np.int64)
        side = size * self._dof + AHEAD + SPARE
        self._normals = room.array('normals', (CHUNKS, side, side))
        self._gradients = room.array('gradients', (CHUNKS, side))
        self.residuals = room.array('residuals', (rows, count), np.float32)
        self._knots_of = room.array('knots', (rows, 2), np.int64)
        self._out = (
            self._begins, self._normals, self._gradients, self.residuals,
            room.array('jacobians', (rows, most * self._dof + AHEAD + SPARE, count), np.float32),
            self._knots_of,
            room.array('edges', (rows, count), np.float32),
            room.array('soft', (rows, count), np.float32),
        )  # fmt: skip
        self._bins = room.array('bins', (BINS,), np.int64)
        self._seen = np.zeros(rows, bool)
        self.gradient = np.zeros(self._knots * self._dof + AHEAD)
        self.believed = self._factor = Arrow.empty(0, 0)

    def renew(self, fit: PathFit, misplaced: float, tukey: bool, lens: bool = True) -> None:
        """
        Sum the normal equations over all rows, in a fixed order.

        `misplaced` [px] is how far an edge may be off, `tukey` chooses the loss (else Huber), and
        `lens` says whether the defocus is an unknown.
        """
        path = fit.path
        samples = path.samples_per_row(point_step(self._level.number))
        self._samples = samples[self._at_full_size.astype(np.int64)]
        self._alone = int(self._samples.sum()) * self.residuals.shape[1] < ALONE
        self._over_rows(linearise, fit, misplaced, tukey, lens)
        touched = int(self._knots_of[:, 1].max())
        self.arrow = Arrow.empty(self._knots * self._dof, max(touched, 2 * self._dof + 1))
        assemble(self._begins, self._dof, self._normals, *self.arrow.parts)
        assemble_gradient(self._begins, self._dof, self._gradients, self.gradient)

    def look(self, fit: PathFit, misplaced: float, tukey: bool) -> None:
        """Work out residuals and gradient anew, on the Jacobians as they are."""
        self._over_rows(correct, fit, misplaced, tukey, False)
        assemble_gradient(self._begins, self._dof, self._gradients, self.gradient)

    def spread(self) -> Residuals:
        """Return how well the fit that was last looked at explains the points."""
        median, cost, used = spread(
            self.residuals, NO_RESIDUAL, OUTLIER, ROW_SEEN, self._bins, BINS_PER_LEVEL, self._seen
        )
        return Residuals(1.4826 * median, cost if used else np.inf, used)

    def step(
        self, priors: Priors, fit: PathFit, sigma: float, before: np.ndarray, share: float
    ) -> tuple[np.ndarray, float, float]:
        """
        Solve the equations together with `priors`; `believed` is then what was solved.

        Parameters
        ----------
        priors : Priors
        fit : PathFit
            Where they were linearised.
        sigma : float
            Standard deviation of the residuals that the priors are weighed against [grey levels].
        before : ndarray of shape (D + AHEAD,)
            The last step, and ...
        share : float
            ... what share of it was taken, 0..1: of steps that turn back and forth it gets less.

        Returns
        -------
        step : ndarray of shape (D + AHEAD,)
        share : float
        row_step : float
            How far it moves the rows that `spread` has seen, root mean square [px].

        """
        path, step = fit.path, np.empty_like(self.gradient)
        size = self.arrow.band.shape
        if self.believed.band.shape != size:
            self.believed, self._factor = Arrow.empty(*size), Arrow.empty(*size)
        share, moved = next_step(
            *priors.arguments(path.control, path.exposure_rows, sigma), *self.arrow.parts,
            self.gradient, *self.believed.parts, *self._factor.parts, before, share, self._dof,
            self._times, path.first_time, path.knot_rows, REACH, self._seen, step,
        )  # fmt: skip
        return step, share, moved**0.5

    def _over_rows(
        self,
        kernel: Callable[..., None],
        fit: PathFit,
        misplaced: float,
        tukey: bool,
        lens: bool,
    ) -> None:
        """Run a kernel over all chunks of rows."""
        path = fit.path
        data = (
            *self._images, self._samples, *self._where, path.control, path.first_time,
            path.knot_rows, path.exposure_rows, fit.defocus - self._start_defocus, *self._camera,
            np.append(fit.light.gain, fit.light.bias), self._tones, self._gamma, fit.sigma,
            misplaced, tukey, lens, *self._out,
        )  # fmt: skip
        if self._executor is None or self._alone:
            kernel(0, CHUNKS, *data)
        else:
            run = partial(_on_chunks, kernel, data)
            shared(self._executor, run, CHUNKS, SMALL, SHARES)


def _on_chunks(
    kernel: Callable[..., None], data: tuple[object, ...], first: int, last: int
) -> None:
    kernel(first, last, *data)


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
