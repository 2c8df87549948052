"""
Camera motion at key rows, fitted to tracked corners.

Ringaby, Forssen, "Efficient video rectification and stabilisation for cell-phones", IJCV 96, 2012,
for two frames of which the reference stands still. `Rotations` is the paper's model, `Planar` its
counterpart for a camera that moves parallel to the ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp

from ..methods import Registration
from ..warping import mapped, places_of_row_homographies, registration_at
from .features import Pairs, check_agreement, tracked_corners

KEY_ROWS = 8
DEFAULT_FOCAL = 0.9  # of the frame's width, where nobody knows
LOSS = 'cauchy'
LOSS_PX = 1.0  # errors well above this hardly count
BEND = 0.05  # weight of second differences between key rows; decides only where tracks are missing


class RowModel(Protocol):
    """Turns three numbers at each key row into a homography at every row."""

    def homographies(self, keys: np.ndarray, motion: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """
        Return the homographies from live to reference pixels at some rows.

        Parameters
        ----------
        keys : ndarray of shape (K,)
            Key rows, ascending [px].
        motion : ndarray of shape (K, 3)
            Motion at the key rows, scaled so that 1 moves pixels by about 1 px.
        rows : ndarray of shape (n,)
            Live rows between the first and the last key row [px].

        Returns
        -------
        ndarray of shape (n, 3, 3), float64

        """


@dataclass(frozen=True)
class Rotations:
    """The camera turns: H = K' R(row) K^-1, R by spherical interpolation of the key rotations."""

    focal: float  # of both images [px]
    live: np.ndarray  # (2,) principal point x, y [px]
    reference: np.ndarray  # (2,) principal point x, y [px]

    def homographies(self, keys: np.ndarray, motion: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Homographies (n, 3, 3) at n rows; see `RowModel`. Motion: rotation vectors x focal."""
        turns = Slerp(keys, Rotation.from_rotvec(motion / self.focal))(rows).as_matrix()
        intrinsics = [
            np.array([[self.focal, 0, x], [0, self.focal, y], [0, 0, 1]])
            for x, y in (self.reference, self.live)
        ]
        return intrinsics[0] @ turns @ np.linalg.inv(intrinsics[1])


@dataclass(frozen=True)
class Planar:
    """The picture moves and turns in its plane: (t_x, t_y, r_z), linear between key rows."""

    radius: float  # where a turn of 1 moves pixels by 1 px [px]
    live: np.ndarray  # (2,) centre x, y [px]
    reference: np.ndarray  # (2,) centre x, y [px]

    def homographies(self, keys: np.ndarray, motion: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Homographies (n, 3, 3) at n rows; see `RowModel`. Motion: t_x, t_y, r_z x radius."""
        t_x, t_y, turn = (np.interp(rows, keys, column) for column in motion.T)
        cos, sin = np.cos(turn / self.radius), np.sin(turn / self.radius)
        hs = np.zeros((len(rows), 3, 3))
        hs[:, 0, 0] = hs[:, 1, 1] = cos
        hs[:, 0, 1], hs[:, 1, 0] = -sin, sin
        hs[:, :2, 2] = self.reference + np.stack([t_x, t_y], 1) - hs[:, :2, :2] @ self.live
        hs[:, 2, 2] = 1
        return hs


def fitted_motion(model: RowModel, pairs: Pairs, keys: np.ndarray) -> np.ndarray:
    """
    Fit the motion at K key rows to tracks by robust least squares on the reprojection error.

    One motion for the whole frame is fitted first: from there on, the loss sees who is an outlier.

    Returns
    -------
    ndarray of shape (K, 3), float64
        See `RowModel`.

    Raises
    ------
    NotRegistered
        If too few tracks agree with the result.

    """
    rows = np.clip(pairs.live[:, 1], keys[0], keys[-1])

    def errors(motion: np.ndarray) -> np.ndarray:
        hs = model.homographies(keys, motion, rows)
        return mapped(hs, *pairs.live.T) - pairs.reference

    def whole(common: np.ndarray) -> np.ndarray:
        return errors(np.tile(common, (len(keys), 1))).ravel()

    def by_row(flat: np.ndarray) -> np.ndarray:
        motion = flat.reshape(-1, 3)
        bends = BEND * np.diff(motion, 2, axis=0)
        return np.concatenate([errors(motion).ravel(), bends.ravel()])

    middle = np.median(pairs.reference - pairs.live, axis=0)
    spread = max(LOSS_PX, float(np.median(np.abs(pairs.reference - pairs.live - middle))))
    start = least_squares(whole, np.zeros(3), loss='soft_l1', f_scale=spread).x
    start = np.tile(start, len(keys))
    for scale in (spread, LOSS_PX):  # wide first: a wobble must not look like outliers
        start = least_squares(by_row, start, loss=LOSS, f_scale=scale, xtol=1e-6, ftol=1e-6).x
    motion = start.reshape(-1, 3)
    check_agreement(np.linalg.norm(errors(motion), axis=1))
    return motion


@dataclass(frozen=True)
class RingabyRegistrar:
    """Rotations of the camera, as in the paper, or motion in the image plane."""

    name: str = 'ringaby'
    planar: bool = False

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        pairs = tracked_corners(reference, live)
        model = self._model(reference.shape, live.shape, focal_px)
        rows = live.shape[0]
        keys = np.linspace(0, rows - 1, KEY_ROWS)
        motion = fitted_motion(model, pairs, keys)
        hs = model.homographies(keys, motion, np.arange(rows, dtype=np.float64))
        return registration_at(places_of_row_homographies(hs, live.shape), reference)

    def _model(
        self, reference: tuple[int, int], live: tuple[int, int], focal_px: float | None
    ) -> RowModel:
        """Model of the motion between images of two shapes (M', N') and (M, N)."""
        centres = [np.array([(cols - 1) / 2, (rows - 1) / 2]) for rows, cols in (live, reference)]
        if self.planar:
            return Planar(live[1] / 2, *centres)
        return Rotations(focal_px or DEFAULT_FOCAL * live[1], *centres)
