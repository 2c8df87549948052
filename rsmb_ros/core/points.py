"""Where a live image is compared: the strongest gradients of some rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ._kernels.fit_row import strongest_gradients

ROW_STEP = 4  # rows between rows of points, at full size
BIN_WIDTH = 7  # px per point at full size, about
LANES = 32  # points per row are a multiple of it: vectorised sums leave no remainder
SWITCHED_OFF = -1.0  # display value of a point that must not count


@dataclass(frozen=True)
class Points:
    """Where the live image is compared at one size."""

    rows: np.ndarray  # (R,)
    columns: np.ndarray  # (R, P)
    values: np.ndarray  # (R, P) display values

    def without(self, mask: np.ndarray) -> Points:
        """Return the points with those on a mask (M, N) bool of this level switched off."""
        off = mask[self.rows[:, None], self.columns]
        return replace(self, values=np.where(off, np.float32(SWITCHED_OFF), self.values))


def select_points(image: np.ndarray, n: int) -> Points:
    """Choose the strongest gradient in each bin of every few rows of one pyramid level."""
    step = max(1, round(ROW_STEP / 2.0 ** (0.7 * n)))
    rows = np.arange(step // 2, image.shape[0], step)
    shape = (len(rows), LANES * max(1, round(image.shape[1] * 1.3**n / (BIN_WIDTH * LANES))))
    columns = np.zeros(shape, np.int64)
    values = np.zeros(shape, np.float32)
    strongest_gradients(image, rows, columns, values)
    return Points(rows, columns, values)
