"""Poses tried for a row, and the poses and weights found for all rows of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ._kernels.rows import blend_rows
from .motion import Grid
from .workers import Workers, each

CHUNKS = 8  # blocks of rows that threads share


@dataclass(frozen=True)
class PoseSpace:
    """N(tau, b, s): all poses around tau that differ by multiples of s, up to b, a component."""

    bounds: tuple[float, ...]  # b: px, px, deg, 1, deg, deg; as many as degrees of freedom
    steps: tuple[float, ...]  # s

    def offsets(self) -> np.ndarray:
        """Differences of the poses from tau (K, 6); tau itself is the middle one."""
        axes = [
            np.arange(-round(b / s), round(b / s) + 1) * s
            for b, s in zip(self.bounds, self.steps, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, len(axes))
        return np.pad(grid, ((0, 0), (0, 6 - len(axes))))

    def first(self, degrees_of_freedom: int) -> PoseSpace:
        """Return the space of the first components only."""
        return PoseSpace(self.bounds[:degrees_of_freedom], self.steps[:degrees_of_freedom])


# Bounds and steps of the journal version (TPAMI 2017), in the order t_x, t_y, r_z, scale, r_x, r_y.
AROUND_NEIGHBOUR = PoseSpace((3.0, 3.0, 1.0, 0.1, 0.1, 0.1), (1.0, 1.0, 0.5, 0.1, 0.1, 0.1))
AROUND_START = PoseSpace((8.0, 8.0, 4.0, 0.0, 0.3, 0.3), (2.0, 2.0, 1.0, 0.1, 0.1, 0.1))


@dataclass(frozen=True)
class RowFit:
    """Poses and weights of every row of an M x N live frame."""

    grid: Grid
    poses: np.ndarray  # (M, K, 6) float64, see `types.MOTION_COLUMNS`
    weights: np.ndarray  # (M, K) float64, share of the exposure at each pose, padded with 0
    solved: np.ndarray  # (M,) bool; the poses of other rows are interpolated
    chi: np.ndarray = field(repr=False)  # (M, N) float32 [grey levels], 0 where unknown
    centroids: np.ndarray = field(repr=False)  # (M, 6) tau_c of each row

    def render(
        self, fine: np.ndarray, relative_depth: float = 1.0, executor: Workers | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Warp the reference to each row's poses and add it up by their weights (Eq. 1).

        Parameters
        ----------
        fine : ndarray of shape (2 rows, 2 cols), float32
            Reference from `sampling.half_pixel`.
        relative_depth : float
            ``d_l`` of the layer that is rendered, background = 1: t becomes t / d.
        executor : Workers, optional
            Threads that share the rows; the result does not depend on them.

        Returns
        -------
        registered : ndarray of shape (M, N), float32
            In the units of `fine`, 0 outside the reference.
        complete : ndarray of shape (M, N), bool
            Where all of the row's poses see the reference.

        """
        rows, cols = self.grid.live_shape
        image, complete = np.empty((rows, cols), np.float32), np.empty((rows, cols), bool)
        flat = fine.ravel()

        def run(chunk: int) -> None:
            blend_rows(
                chunk * rows // CHUNKS, (chunk + 1) * rows // CHUNKS, flat, *fine.shape,
                self.poses, self.weights, self.grid.focal_px, self.grid.center,
                1.0 / relative_depth, image, complete,
            )  # fmt: skip

        if executor is None:
            list(map(run, range(CHUNKS)))
        else:
            each(executor, run, range(CHUNKS))
        return image, complete
