"""
Camera motion: one continuous path per frame, and the poses on it.

A pose is tau = (t_x, t_y, r_z, scale, r_x, r_y) in px, px, deg, 1, deg, deg
(`types.MOTION_COLUMNS`) and maps live pixels to reference pixels by H = K (R + T n^T / d) K^-1,
R = exp of the rotation vector, n = (0, 0, 1), scale = 1 / (1 + T_z), t = f (T_x, T_y) scale
(Eq. 2 and section 2.1.2 of the report).

The path is estimated in **path coordinates** q = (a_x, a_y, rho, zeta, p_x, p_y), all in px:
where the image centre goes, and how far rotation, zoom and the two perspective terms move a pixel
at half the image width. They move the image independently, which t and r_x, r_y do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ._kernels import geometry

COORDINATES = 6
CENTROID_SAMPLES = 16  # instants per exposure in a row's centroid


@dataclass(frozen=True)
class Grid:
    """Sizes and centres that tie live pixels to reference pixels."""

    live_shape: tuple[int, int]  # M, N of the live frame [px]
    reference_shape: tuple[int, int]  # M, N of the reference [px]
    focal_px: float  # [px]

    @property
    def half_width(self) -> float:
        """Half the live image's width [px]."""
        return self.live_shape[1] / 2.0

    @property
    def center(self) -> np.ndarray:
        """Live centre x, y and reference centre x, y [px]."""
        (rows, cols), (ref_rows, ref_cols) = self.live_shape, self.reference_shape
        return np.array([cols - 1, rows - 1, ref_cols - 1, ref_rows - 1], np.float64) / 2.0


@dataclass(frozen=True)
class CameraPath:
    """
    Cubic B-spline p(t) of the camera; t counts rows in the order they are read, from 0.

    What follows from it is worked out once: `control` must not be changed after that.
    """

    grid: Grid
    control: np.ndarray  # (knots, 6) float64 path coordinates [px]
    first_time: float  # time of the first knot span [rows]
    knot_rows: float  # distance of the knots [rows]
    exposure_rows: float  # t_e / t_d; row i is lit during t_i -+ half of it [rows]
    bottom_up: bool = False  # row M-1 is read first

    @property
    def row_times(self) -> np.ndarray:
        """Time of the middle of each row's exposure (M,) [rows]."""
        times = np.arange(self.grid.live_shape[0], dtype=np.float64)
        return times[::-1].copy() if self.bottom_up else times

    def spline_basis(self, times: np.ndarray) -> np.ndarray:
        """Weights of the control points at `times` (n,), shape (n, knots)."""
        return spline_weights(times, self.first_time, self.knot_rows, len(self.control))

    def coordinates(self, times: np.ndarray) -> np.ndarray:
        """Path coordinates at `times`, shape ``times.shape + (6,)`` [px]."""
        flat = self.spline_basis(times.ravel()) @ self.control
        return flat.reshape(*times.shape, COORDINATES)

    def row_centroids(self) -> np.ndarray:
        """Mean path coordinates over each row's exposure (M, 6) [px]."""
        return self._centroids.copy()

    @cached_property
    def _centroids(self) -> np.ndarray:
        means = np.empty((self.grid.live_shape[0], COORDINATES))
        geometry.mean_coordinates(
            self.row_times, CENTROID_SAMPLES, self.exposure_rows, self.control, self.first_time,
            self.knot_rows, means,
        )  # fmt: skip
        return means

    def row_motion(self) -> np.ndarray:
        """Centroid pose tau_c of each row (M, 6), see `types.MOTION_COLUMNS`."""
        return poses_from_coordinates(self.row_centroids(), self.grid)

    def samples_per_row(
        self, step_px: float, stretch: float = 1.0, most: int = geometry.MOST_INSTANTS
    ) -> np.ndarray:
        """Instants needed per row so that no point moves more than `step_px` in between (M,)."""
        run = self._runs * stretch
        return np.clip(np.ceil(run / step_px) + 1, 2, most).astype(np.int64)

    @cached_property
    def _runs(self) -> np.ndarray:
        """How far a corner of the frame moves during each row's exposure (M,) [px]."""
        rows = self.grid.live_shape[0]
        steps = math.ceil((rows + self.exposure_rows) / geometry.RUN_STEP) + 1
        runs = np.empty(rows)
        geometry.corner_runs(
            self.row_times, self.exposure_rows, self.control, self.first_time, self.knot_rows,
            geometry.RUN_STEP, np.empty(steps), runs,
        )  # fmt: skip
        return runs

    @property
    def offset(self) -> np.ndarray:
        """Where the middle of the frame lies (2,) [px from the reference's centre]."""
        middle = 0.5 * (self.grid.live_shape[0] - 1)
        return self.coordinates(np.array([middle]))[0, :2]

    def row_homographies(self, relative_depth: float = 1.0) -> np.ndarray:
        """Homography of each row's centroid pose between centred pixels (M, 3, 3)."""
        return homographies(self.row_centroids(), self.grid, relative_depth)


def spline_weights(
    times: np.ndarray, first_time: float, knot_rows: float, knots: int
) -> np.ndarray:
    """Weights of `knots` control points of a cubic B-spline at `times` (n,), shape (n, knots)."""
    s = np.clip((times - first_time) / knot_rows, 0.0, knots - 3.000001)
    span = s.astype(np.int64)
    u = s - span
    v = 1.0 - u
    parts = [v**3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]
    weights = np.zeros((len(times), knots))
    for n, part in enumerate(parts):
        weights[np.arange(len(times)), span + n] = part / 6.0
    return weights


def shifted(path: CameraPath, relative_depth: float, shift: tuple[float, float]) -> CameraPath:
    """Return the path that moves a layer at `relative_depth` by `shift` x, y more [px]."""
    if shift == (0.0, 0.0):
        return path
    control = path.control.copy()
    control[:, :2] += relative_depth * np.asarray(shift)  # layers move by t / d
    return replace(path, control=control)


def moved_px(one: CameraPath, other: CameraPath, rows: np.ndarray | None = None) -> float:
    """
    Return how far two paths of the same frame place the middle of their rows apart, at most.

    Of the `rows` (M,) bool, where given; 0 where these are none.
    """
    apart = one.row_centroids()[:, :2] - other.row_centroids()[:, :2]
    return float(np.hypot(*(apart if rows is None else apart[rows]).T).max(initial=0.0))


def still_path(
    grid: Grid, knot_rows: float, exposure_rows: float, longest_exposure: float, bottom_up: bool
) -> CameraPath:
    """Return a path of zero motion whose knots also cover an exposure of `longest_exposure`."""
    first = -0.5 * longest_exposure - 1.0
    spans = math.ceil((grid.live_shape[0] + longest_exposure + 2.0) / knot_rows)
    control = np.zeros((spans + 3, COORDINATES))
    return CameraPath(grid, control, first, knot_rows, exposure_rows, bottom_up)


def homographies(coordinates: np.ndarray, grid: Grid, relative_depth: float = 1.0) -> np.ndarray:
    """Homographies (n, 3, 3) between centred pixels for path coordinates (n, 6)."""
    out = np.empty((len(coordinates), 9))
    geometry.homographies(
        np.asarray(coordinates, np.float64),
        grid.focal_px,
        grid.half_width,
        1.0 / relative_depth,
        out,
    )
    return out.reshape(-1, 3, 3)


def rotation_matrices(vectors: np.ndarray) -> np.ndarray:
    """Rodrigues: rotation vectors (n, 3) [rad] -> matrices (n, 3, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    safe = np.where(angle < 1e-12, 1.0, angle)
    return (
        np.eye(3)
        + np.where(angle < 1e-12, 1.0, np.sin(safe) / safe) * cross
        + np.where(angle < 1e-12, 0.5, (1.0 - np.cos(safe)) / safe**2) * (cross @ cross)
    )


def poses_from_coordinates(coordinates: np.ndarray, grid: Grid) -> np.ndarray:
    """Path coordinates q (n, 6) [px] -> poses tau (n, 6)."""
    a_x, a_y, rho, zeta, p_x, p_y = np.asarray(coordinates, np.float64).T
    f, w = grid.focal_px, grid.half_width
    r = np.stack([-np.arctan(p_y * f / w**2), np.arctan(p_x * f / w**2), rho / w], axis=1)
    rotation = rotation_matrices(r)
    zoom = w / (w + zeta)
    scale = 1.0 / (1.0 + zoom - rotation[:, 2, 2])
    t_x = (a_x * zoom - f * rotation[:, 0, 2]) * scale
    t_y = (a_y * zoom - f * rotation[:, 1, 2]) * scale
    r_x, r_y, r_z = np.degrees(r).T
    return np.stack([t_x, t_y, r_z, scale, r_x, r_y], axis=1)


def coordinates_from_poses(poses: np.ndarray, grid: Grid) -> np.ndarray:
    """Poses tau (n, 6) -> path coordinates q (n, 6) [px]; inverse of `poses_from_coordinates`."""
    t_x, t_y, r_z, scale, r_x, r_y = np.asarray(poses, np.float64).T
    f, w = grid.focal_px, grid.half_width
    r_x, r_y, r_z = np.radians([r_x, r_y, r_z])
    rotation = rotation_matrices(np.stack([r_x, r_y, r_z], axis=1))
    zoom = 1.0 / scale - 1.0 + rotation[:, 2, 2]
    a_x = (t_x / scale + f * rotation[:, 0, 2]) / zoom
    a_y = (t_y / scale + f * rotation[:, 1, 2]) / zoom
    tilt = w**2 / f
    return np.stack(
        [a_x, a_y, r_z * w, w / zoom - w, np.tan(r_y) * tilt, -np.tan(r_x) * tilt], axis=1
    )
