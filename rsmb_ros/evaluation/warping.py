"""From places in the reference to a registered image."""

from __future__ import annotations

import cv2
import numpy as np

from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies

from .methods import NotRegistered, Registration

NOWHERE = 1e6  # px, stands for places behind the camera or farther away than this
MIN_INSIDE = 0.05  # share of the live frame that must lie in the reference


def registration_at(places: np.ndarray, reference: np.ndarray) -> Registration:
    """
    Sample the reference bilinearly where each live pixel lies.

    Parameters
    ----------
    places : ndarray of shape (M, N, 2)
        x, y in the reference [px].
    reference : ndarray of shape (M', N'), float32
        Grey levels.

    Raises
    ------
    NotRegistered
        If less than ``MIN_INSIDE`` of the live frame lies in the reference.

    """
    places = np.nan_to_num(places, nan=NOWHERE, posinf=NOWHERE, neginf=-NOWHERE)
    places = np.ascontiguousarray(np.clip(places, -NOWHERE, NOWHERE), np.float32)
    last = np.array(reference.shape[::-1], np.float32) - 1
    inside = ((places >= 0) & (places <= last)).all(axis=2)
    share = float(inside.mean())
    if share < MIN_INSIDE:
        raise NotRegistered(
            f'{share:.0%} of the frame lies in the reference, need {MIN_INSIDE:.0%}'
        )
    registered = cv2.remap(
        reference, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return Registration(registered, inside, places)


def pixel_grid(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return x of shape (1, N) and y of shape (M, 1) of every pixel of a frame, float64 [px]."""
    rows, cols = shape
    return np.arange(cols, dtype=np.float64)[None, :], np.arange(rows, dtype=np.float64)[:, None]


def places_of_homography(h: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Places (M, N, 2) float32 [px] under one homography (3, 3), live pixel -> reference pixel."""
    return places_of_row_homographies(np.broadcast_to(h, (shape[0], 3, 3)), shape)


def places_of_row_homographies(hs: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Places (M, N, 2) float32 [px] under a homography per live row, (M, 3, 3)."""
    x, y = pixel_grid(shape)
    return mapped(hs[:, None], x, y).astype(np.float32)


def places_of_poses(poses: np.ndarray, grid: Grid, distortion: float = 0.0) -> np.ndarray:
    """
    Places (M, N, 2) float32 [px] of every live pixel under a pose per row.

    Parameters
    ----------
    poses : ndarray of shape (M, 6)
        tau of each row, see `core.types.MOTION_COLUMNS`.
    grid : Grid
        Sizes of live frame and reference, focal length.
    distortion : float
        Radial, of both images: a point at half the width comes from ``1 + distortion`` times as
        far out.

    """
    x, y = pixel_grid(grid.live_shape)
    x, y = np.broadcast_arrays(x - grid.center[0], y - grid.center[1])
    stretch = 1.0 + distortion * (x**2 + y**2) / grid.half_width**2
    hs = homographies(coordinates_from_poses(poses, grid), grid)
    ideal = mapped(hs[:, None], x * stretch, y * stretch)
    place = ideal
    for _ in range(4 if distortion else 0):  # inverse of p (1 + k |p|^2)
        radius = (place**2).sum(axis=-1, keepdims=True) / grid.half_width**2
        place = ideal / (1.0 + distortion * radius)
    return (place + grid.center[2:]).astype(np.float32)


def mapped(hs: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """
    Apply homographies to points; points behind the camera become ``NOWHERE``.

    Parameters
    ----------
    hs : ndarray of shape (..., 3, 3)
    x, y : ndarray
        Points [px]; broadcast against the leading axes of `hs`.

    Returns
    -------
    ndarray of shape (..., 2), float64
        x, y [px].

    """
    u, v, w = (hs[..., i, 0] * x + hs[..., i, 1] * y + hs[..., i, 2] for i in range(3))
    ahead = w > 1e-9
    w = np.where(ahead, w, 1.0)
    return np.stack([np.where(ahead, u / w, NOWHERE), np.where(ahead, v / w, NOWHERE)], axis=-1)
