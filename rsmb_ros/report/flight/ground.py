"""Where the pixels of a live frame lie on its reference, and what of it was judged."""

from __future__ import annotations

import math

import numpy as np

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.config import Config
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.types import Result

_CELLS_ACROSS = 120  # of the reference's longer side, at most
_SMALLEST_CELL = 8  # px


class Ground:
    """
    Maps one registered frame to its reference, as if all of it were background.

    Parameters
    ----------
    result : Result
        Registered.
    reference_shape : (int, int)
        Rows and columns.
    focal_px : float
        The one its poses were worked out with [px].

    """

    def __init__(self, result: Result, reference_shape: tuple[int, int], focal_px: float) -> None:
        shape = result.valid_mask.shape
        grid = Grid((shape[0], shape[1]), reference_shape, focal_px)
        self._center = grid.center
        self._rows = homographies(coordinates_from_poses(result.row_motion, grid), grid)

    def on_reference(self, points: np.ndarray) -> np.ndarray:
        """
        Map points of the live frame, each by the pose of its row.

        Parameters
        ----------
        points : ndarray of shape (n, 2)
            x, y [px].

        Returns
        -------
        ndarray of shape (n, 2), float64
            NaN where a row has no pose.

        """
        row = np.clip(np.rint(points[:, 1]), 0, len(self._rows) - 1).astype(np.int64)
        centred = np.c_[points - self._center[:2], np.ones(len(points))]
        u, v, w = np.einsum('nij,nj->in', self._rows[row], centred)
        return np.stack([u / w, v / w], axis=1) + self._center[2:]


class Coverage:
    """
    Which cells of a reference at least one frame judged.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the reference.

    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.cell = max(_SMALLEST_CELL, math.ceil(max(shape) / _CELLS_ACROSS))  # px
        self.judged = np.zeros([math.ceil(side / self.cell) for side in shape], bool)

    def add(self, ground: Ground, valid_mask: np.ndarray) -> None:
        """Mark what a frame judged, `valid_mask` (M, N) uint8."""
        step = max(1, self.cell // 2)
        y, x = np.nonzero(valid_mask[::step, ::step])
        places = ground.on_reference(step * np.stack([x, y], axis=1).astype(np.float64))
        cells = np.floor(places[np.isfinite(places).all(axis=1)] / self.cell).astype(np.int64)
        inside = (cells >= 0).all(axis=1) & (cells < self.judged.shape[::-1]).all(axis=1)
        self.judged[cells[inside, 1], cells[inside, 0]] = True

    @property
    def share(self) -> float:
        """Share of the reference that was judged, 0..1."""
        return float(self.judged.mean())


def focal_of(config: Config, camera: Camera | None, width: int) -> float:
    """Return the focal length [px] that a `Detector` uses for frames of `width` px."""
    if config.camera.focal_px > 0:
        return config.camera.focal_px
    return (camera or Camera.guess(width)).focal_px
