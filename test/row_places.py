"""Where the rows of a frame lie in its reference."""

from __future__ import annotations

import numpy as np

from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies


def row_places(poses: np.ndarray, grid: Grid, x: float = 0.0) -> np.ndarray:
    """Reference place of the point `x` px right of the centre of each row (M, 2) [px]."""
    y = np.arange(len(poses)) - (len(poses) - 1) / 2
    points = np.stack([np.full_like(y, x), y, np.ones_like(y)], axis=1)
    h = homographies(coordinates_from_poses(poses, grid), grid)
    mapped = np.einsum('nij,nj->ni', h, points)
    return mapped[:, :2] / mapped[:, 2:]


def row_errors(found: np.ndarray, true: np.ndarray, grid: Grid, x: float = 0.0) -> np.ndarray:
    """Distance between where poses that were `found` and the `true` ones place it (M,) [px]."""
    return np.hypot(*(row_places(found, grid, x) - row_places(true, grid, x)).T)
