"""
Row estimator, the report's own: every row is solved for the poses it saw (Eq. 6-10).

A block of rows in the middle is solved over a wide grid of poses; from there outwards each row is
solved over the poses around its neighbour's centroid, the upper and the lower half on their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ._kernels.rows import drop_unseen, warp_rows
from .errors import ConfigError, FrameError
from .motion import Grid
from .row_fit import AROUND_NEIGHBOUR, AROUND_START, RowFit
from .row_solver import LAMBDA_2, WHITE, change_of, solve_row_osqp, solve_transposed
from .sampling import half_pixel
from .workers import Workers, each

DEGREES_OF_FREEDOM = (2, 3, 6)  # t_x t_y | r_z | scale r_x r_y
SOLVERS = ('active_set', 'osqp')
BLOCKS = 6  # tried one after the other, until one can be solved
BLOCK_ROWS = 7  # solved jointly: a single row cannot tell a turn from a shift

# A row is homogeneous, and skipped, when fewer than this share of its neighbouring pixels differ by
# more than so many grey levels. The papers give neither number; these are ours: 5 is above the
# noise of a camera, and 8 such steps in a row of 384 place it.
STEP_LEVELS = 5.0
MIN_STEPS = 0.02
ENOUGH_SEEN = 0.25  # share of a row that must lie in the reference
POSE_SEES = 0.75  # share of what the middle pose sees that every other one must see
# A row of which the poses leave more than this share unexplained does not show the reference; how
# far a pixel is off counts up to 3 delta, so that a change does not outweigh the row it lies in.
# Measured: 0.05..0.1 clean, 0.2..0.4 with a camera's noise, + 0.3 with a fifth of the row changed;
# foreign rows 0.65 and more, foreign blocks 0.8. A block's grid is coarse and leaves more.
MOST_UNEXPLAINED = 0.6
MOST_UNEXPLAINED_OF_BLOCK = 0.75
LARGE_MISFIT = 3.0 * LAMBDA_2 / WHITE  # grey levels
MOST_VALUES = 25_000_000  # of F for the block; with more, only every n-th pixel is used


def _alone(grid: Grid, poses: np.ndarray) -> RowFit:
    """Return the fit of rows that saw one pose each, (M, 6)."""
    rows = len(poses)
    nothing = np.zeros(grid.live_shape, np.float32)
    return RowFit(
        grid, poses[:, None].astype(np.float64), np.ones((rows, 1)), np.zeros(rows, bool), nothing,
        poses,
    )  # fmt: skip


@dataclass(frozen=True)
class _Solution:
    """Poses of one row or block that share its light."""

    poses: np.ndarray  # (k, 6)
    weights: np.ndarray  # (k,), > 0
    over_space: np.ndarray  # (K,) the same over all poses tried

    @property
    def centroid(self) -> np.ndarray:
        return self.weights @ self.poses / self.weights.sum()


class RowEstimator:
    """
    Solves live frames of one size against one reference, row by row.

    Parameters
    ----------
    reference : ndarray of shape (rows, cols), float32
        Display grey levels 0..255: the report adds intensities as they are.
    grid : Grid
        Sizes and focal length.
    executor : Workers
        Threads; two are used, the result does not depend on them.
    degrees_of_freedom : int
        2: t_x t_y, 3: + r_z, 6: + scale r_x r_y. The others keep the start's values.
    solver : str
        'active_set', or 'osqp' as a slow cross-check.

    Raises
    ------
    ConfigError
        If an option is not one of those.

    """

    def __init__(
        self,
        reference: np.ndarray,
        grid: Grid,
        executor: Workers,
        *,
        degrees_of_freedom: int = 3,
        solver: str = 'active_set',
    ) -> None:
        if degrees_of_freedom not in DEGREES_OF_FREEDOM:
            raise ConfigError(
                f'degrees_of_freedom = {degrees_of_freedom!r} is not allowed for rows: '
                f'must be one of {DEGREES_OF_FREEDOM}'
            )
        if solver not in SOLVERS:
            raise ConfigError(f'solver = {solver!r} is not allowed: must be one of {SOLVERS}')
        if reference.shape != grid.reference_shape:
            raise FrameError(
                f'reference is {reference.shape} but the grid expects {grid.reference_shape}'
            )
        self._fine = half_pixel(reference.astype(np.float32))
        self._grid = grid
        self._executor = executor
        self._dof = degrees_of_freedom
        self._solver = solver
        self._near = AROUND_NEIGHBOUR.first(degrees_of_freedom).offsets()
        self._wide = AROUND_START.first(degrees_of_freedom).offsets()

    def estimate(self, live: np.ndarray, start_poses: np.ndarray) -> RowFit:
        """
        Solve all rows of one live frame.

        Parameters
        ----------
        live : ndarray of shape (M, N), float32
            Display grey levels 0..255.
        start_poses : ndarray of shape (M, 6)
            tau of each row from a coarse start.

        Returns
        -------
        RowFit
            Never an exception on image content: a row without texture, outside the reference or
            unlike it is not `solved`.

        """
        rows = self._grid.live_shape[0]
        solutions: list[_Solution | None] = [None] * rows
        usable = self._usable(live, start_poses)
        middle, centroid = self._first_centroid(live, usable, start_poses)
        if centroid is not None:
            halves = [range(middle, -1, -1), range(middle + 1, rows)]

            def walk(half: range) -> None:
                self._walk(live, usable, start_poses, half, centroid, solutions)

            each(self._executor, walk, halves)
        return self._fit(live, start_poses, solutions)

    def _usable(self, live: np.ndarray, start_poses: np.ndarray) -> np.ndarray:
        """Rows (M,) that are homogeneous neither in the live frame nor in the reference."""
        alone = _alone(self._grid, start_poses)
        seen, inside = alone.render(self._fine, executor=self._executor)
        return np.array(
            [
                known.mean() >= ENOUGH_SEEN and _has_texture(row) and _has_texture(other[known])
                for row, other, known in zip(live, seen, inside, strict=True)
            ]
        )

    def _first_centroid(
        self, live: np.ndarray, usable: np.ndarray, start_poses: np.ndarray
    ) -> tuple[int, np.ndarray | None]:
        """Middle row and centroid of the first block that can be solved; None: no block can."""
        for block in _blocks(usable):
            middle = int(block[len(block) // 2])
            found = self._solve(live, block, start_poses[middle], self._wide)
            if found is not None:
                return middle, found.centroid
        return 0, None

    def _walk(
        self,
        live: np.ndarray,
        usable: np.ndarray,
        start_poses: np.ndarray,
        rows: range,
        last: np.ndarray,
        solutions: list[_Solution | None],
    ) -> None:
        """Solve `rows` one after the other, each around the centroid `last` of the one before."""
        warm = None
        for i in rows:
            centre = start_poses[i].copy()
            centre[: self._dof] = last[: self._dof]
            found = None
            if usable[i]:
                found = self._solve(live, np.array([i]), centre, self._near, warm)
            if found is not None:
                last, warm = found.centroid, found.over_space
                solutions[i] = found
            elif i + rows.step in rows:  # a skipped row moves as the start does
                last = last + start_poses[i + rows.step] - start_poses[i]

    def _solve(
        self,
        live: np.ndarray,
        rows: np.ndarray,
        centre: np.ndarray,
        offsets: np.ndarray,
        warm: np.ndarray | None = None,
    ) -> _Solution | None:
        """Solve `rows` jointly over the poses around `centre`; None if that explains nothing."""
        poses = centre + offsets
        grid = self._grid
        stride = 1 + len(poses) * len(rows) * grid.live_shape[1] // MOST_VALUES
        row = live[rows, ::stride].astype(np.float64).ravel()
        columns = np.empty((len(poses), row.size), np.float32)
        counts = np.empty(len(poses), np.int64)
        warp_rows(
            rows, stride, poses, self._fine.ravel(), *self._fine.shape, grid.focal_px, grid.center,
            columns, counts,
        )  # fmt: skip
        sees = counts[len(poses) // 2]
        known = np.empty(row.size, bool)
        drop_unseen(columns, counts, POSE_SEES * sees, row, known)
        if min(sees, known.sum()) < ENOUGH_SEEN * row.size:
            return None
        if self._solver == 'osqp':
            weights, _ = solve_row_osqp(columns.T, row)
            residual = row - weights @ columns
        else:
            weights, residual = solve_transposed(columns, row, start=warm)
        active = weights > 0
        most = MOST_UNEXPLAINED if len(rows) == 1 else MOST_UNEXPLAINED_OF_BLOCK
        if not active.any() or _unexplained(row[known], residual[known]) > most:
            return None
        return _Solution(poses[active], weights[active], weights)

    def _fit(
        self, live: np.ndarray, start_poses: np.ndarray, solutions: Sequence[_Solution | None]
    ) -> RowFit:
        """Fill the rows without solution from their neighbours; find the change of all."""
        rows = len(solutions)
        solved = np.array([solution is not None for solution in solutions])
        at = np.flatnonzero(solved)
        centroids = start_poses.astype(np.float64)
        found = [s for s in solutions if s is not None]
        most = max((len(s.weights) for s in found), default=1)
        poses, weights = np.zeros((rows, most, 6)), np.zeros((rows, most))
        poses[:] = centroids[:, None]
        if found:
            shift = np.array([s.centroid for s in found]) - centroids[at]
            centroids += np.stack([np.interp(range(rows), at, e) for e in shift.T], axis=1)
            nearest = np.abs(np.arange(rows)[:, None] - at).argmin(axis=1)
            for i, n in enumerate(nearest):
                used = len(found[n].weights)
                move = 0.0 if solved[i] else centroids[i] - centroids[at[n]]
                poses[i, :used] = found[n].poses + move
                weights[i, :used] = found[n].weights
        else:
            weights[:, 0] = 1.0
        fit = RowFit(self._grid, poses, weights, solved, np.zeros(live.shape), centroids)
        registered, complete = fit.render(self._fine, executor=self._executor)
        chi = np.where(complete, change_of(live - registered), 0.0).astype(np.float32)
        return RowFit(self._grid, poses, weights, solved, chi, centroids)


def _unexplained(row: np.ndarray, residual: np.ndarray) -> float:
    """Mean misfit of a row over its mean distance from its median, both truncated; >= 0."""
    misfit = np.minimum(np.abs(residual), LARGE_MISFIT).mean()
    contrast = np.minimum(np.abs(row - np.median(row)), LARGE_MISFIT).mean()
    return float(misfit / max(contrast, 1e-9))


def _has_texture(row: np.ndarray) -> bool:
    """Tell whether enough neighbouring pixels of a row differ (section 2.4 of the journal)."""
    return float(np.mean(np.abs(np.diff(row)) > STEP_LEVELS)) >= MIN_STEPS


def _blocks(usable: np.ndarray) -> Iterator[np.ndarray]:
    """Yield rows of some blocks to start from: few homogeneous rows, then near the middle."""
    size = min(BLOCK_ROWS, len(usable))
    counts = np.convolve(usable, np.ones(size, int), 'valid')
    distance = np.abs(np.arange(len(counts)) - (len(counts) - 1) / 2)
    for _ in range(BLOCKS):
        first = int(np.lexsort((distance, -counts))[0])
        if counts[first] == 0:
            return
        yield np.arange(first, first + size)
        counts[max(0, first - size) : first + size + 1] = 0  # the next one shares no row
