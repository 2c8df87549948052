"""Where a live image is compared: the strongest gradients of some rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._kernels.depth import point_depths
from ._kernels.fit_row import strongest_gradients
from .depth_map import EDGE_STEP, DepthMap
from .motion import CameraPath, Grid
from .photometric import to_display, to_linear
from .sampling import pyramid

ROW_STEP = 4  # rows between rows of points, at full size
BIN_WIDTH = 7  # px per point at full size, about
LANES = 32  # points per row are a multiple of it: vectorised sums leave no remainder
SWITCHED_OFF = -1.0  # display value of a point that must not count
EDGE = 2  # px of the level around an edge of the depth, in which no points count
DEPTH_STEP = 2.0  # px of the level between the instants a point's depth is looked up at


@dataclass(frozen=True)
class Points:
    """Where the live image is compared at one size."""

    rows: np.ndarray  # (R,)
    columns: np.ndarray  # (R, P)
    values: np.ndarray  # (R, P) display values
    inverse_depth: np.ndarray | None = None  # (R, P) float32, 1/d; None: all on the background

    def only(self, chosen: np.ndarray) -> Points:
        """Return the points with those not `chosen` (R, P) bool switched off."""
        return replace(self, values=np.where(chosen, self.values, np.float32(SWITCHED_OFF)))

    def without(self, mask: np.ndarray) -> Points:
        """Return the points with those on a mask (M, N) bool of this level switched off."""
        return self.only(~mask[self.rows[:, None], self.columns])

    def every(self, n: int) -> Points:
        """Return the points of every n-th row."""
        return self._of(np.s_[::n])

    def between(self, first: int, last: int, n: int) -> Points:
        """Return the points of pyramid level `n` in rows `first` to `last` of the full image."""
        at_full_size = (self.rows + 0.5) * 2.0**n - 0.5
        return self._of(slice(*np.searchsorted(at_full_size, (first, last))))

    def _of(self, rows: slice) -> Points:
        """Return the points of some rows of points."""
        depth = self.inverse_depth
        return replace(
            self,
            rows=self.rows[rows].copy(),  # contiguous: kernels are compiled once
            columns=self.columns[rows].copy(),
            values=self.values[rows].copy(),
            inverse_depth=None if depth is None else depth[rows].copy(),
        )

    def from_center(self, factor: float, grid: Grid) -> np.ndarray:
        """Columns (R, P) float32 from the live centre [px of the full image]."""
        columns = self.columns.astype(np.float32)  # whole numbers: what follows is exact
        return columns * np.float32(factor) + np.float32(0.5 * factor - 0.5 - grid.center[0])

    def on(self, depth: DepthMap, path: CameraPath, n: int) -> Points:
        """
        Return the points of pyramid level `n` at the depths that `path` lets them see.

        Those that see an edge of the depth, or what lies behind it, are switched off.
        """
        factor = 2.0**n
        radius = round(EDGE * factor) + 1
        at_full_size = np.clip((self.rows + 0.5) * factor - 0.5, 0, len(path.row_times) - 1)
        samples = path.samples_per_row(DEPTH_STEP * factor)[at_full_size.astype(int)]
        inverse = np.zeros(self.values.shape, np.float32)
        point_depths(
            0, len(self.rows), self.rows, self.columns, factor,
            np.interp(at_full_size, np.arange(len(path.row_times)), path.row_times), samples,
            path.control, path.first_time, path.knot_rows, path.exposure_rows,
            path.grid.focal_px, path.grid.center, depth.inverse_depths, depth.possible(radius),
            radius, depth.smooth(radius), EDGE_STEP, inverse,
        )  # fmt: skip
        off = inverse == 0.0
        return replace(
            self,
            values=np.where(off, np.float32(SWITCHED_OFF), self.values),
            inverse_depth=np.where(off, np.float32(1.0), inverse),
        )


class LiveImage:
    """A live frame, and where it is compared at each size: chosen once, on demand."""

    def __init__(self, grey: np.ndarray, gamma: float) -> None:
        """Take the frame's grey levels (M, N) float32 and the camera's tone curve."""
        self.grey = grey
        self._gamma = gamma
        self._sizes = [to_linear(grey, gamma)]
        self._points = [select_points(grey, 0)]

    def points(self, count: int) -> list[Points]:
        """Return the points at the `count` finest sizes, full size first."""
        while len(self._points) < count:
            self._sizes.append(pyramid(self._sizes[-1], 2)[1])
            image = to_display(self._sizes[-1], self._gamma)
            self._points.append(select_points(image, len(self._points)))
        return self._points[:count]


def select_points(image: np.ndarray, n: int) -> Points:
    """Choose the strongest gradient in each bin of every few rows of one pyramid level."""
    step = max(1, round(ROW_STEP / 2.0 ** (0.7 * n)))
    rows = np.arange(step // 2, image.shape[0], step)
    shape = (len(rows), LANES * max(1, round(image.shape[1] * 1.3**n / (BIN_WIDTH * LANES))))
    columns = np.zeros(shape, np.int64)
    values = np.zeros(shape, np.float32)
    strongest_gradients(image, rows, columns, values)
    return Points(rows, columns, values)
