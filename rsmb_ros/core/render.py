"""Render the registered and the rectified image from a known path."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass

import cv2
import numpy as np

from ._kernels.render import blur_rows, live_places
from .motion import CameraPath

CHUNKS = 8  # blocks of rows that threads share
SMALL = 1 << 14  # px; handing out less than that takes longer than doing it
STEP_PX = 1.0  # px the reference moves between two instants of the exposure


@dataclass(frozen=True)
class Window:
    """Rows top..bottom and columns left..right (exclusive) of the live frame [px]."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def box(self) -> tuple[slice, slice]:
        """Index of the window in an image."""
        return np.s_[self.top : self.bottom, self.left : self.right]


def blurred(
    fine: np.ndarray,
    path: CameraPath,
    executor: Executor,
    relative_depth: float = 1.0,
    window: Window | None = None,
    step_px: float = STEP_PX,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Warp the reference row by row and average it over each row's exposure (Eq. 1).

    Parameters
    ----------
    fine : ndarray of shape (2 rows, 2 cols), float32
        Reference from `sampling.half_pixel`, linear light.
    path : CameraPath
        Motion of the live camera.
    executor : Executor
        Threads that share the rows.
    relative_depth : float
        ``d_l`` of the layer that is rendered, background = 1.
    window : Window, optional
        Part of the live frame; default all of it.
    step_px : float
        How far the reference may move between two instants of the exposure [px].

    Returns
    -------
    image : ndarray, float32
        Linear light, 0 outside the reference; shape of the window.
    complete : ndarray of bool
        Where the reference covers the whole exposure; shape of the window.

    """
    rows, cols = path.grid.live_shape
    window = window or Window(0, rows, 0, cols)
    height, width = window.bottom - window.top, window.right - window.left
    image = np.empty((height, width), np.float32)
    begins, ends = np.empty(height, np.int64), np.empty(height, np.int64)
    samples = path.samples_per_row(step_px, stretch=max(1.0, 1.0 / relative_depth))
    times, flat = path.row_times, fine.ravel()

    def run(chunk: int) -> None:
        blur_rows(
            window.top + chunk * height // CHUNKS, window.top + (chunk + 1) * height // CHUNKS,
            window.top, window.left, window.right, flat, *fine.shape, times, samples, path.control,
            path.first_time, path.knot_rows, path.exposure_rows, path.grid.focal_px,
            path.grid.center, 1.0 / relative_depth, image, begins, ends,
        )  # fmt: skip

    if height * width < SMALL:
        for chunk in range(CHUNKS):
            run(chunk)
    else:
        list(executor.map(run, range(CHUNKS)))
    column = np.arange(window.left, window.right)
    complete = (column >= begins[:, None]) & (column < ends[:, None])
    return image, complete


def rectified(live: np.ndarray, path: CameraPath, executor: Executor) -> np.ndarray:
    """
    Bring a live image back to the reference's grid through each row's centroid pose.

    Rolling shutter is undone, blur is not. `live` is (M, N) or (M, N, 3) uint8; pixels that the
    live frame does not show are 0.
    """
    return at_places(live, shown_at(path, executor), cv2.INTER_CUBIC)


def shown_at(
    path: CameraPath, executor: Executor, surface: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """
    Find where the live frame shows each pixel of the reference, at each row's centroid pose.

    `surface` (M, N) float32 is 1/d of the reference, None: 1 everywhere. Returns columns and rows,
    float32 on the reference's grid; they may lie outside the frame.
    """
    rows, cols = path.grid.reference_shape
    background, far = path.row_homographies(), path.row_homographies(np.inf)
    inverses = np.linalg.inv(background)
    shifts = np.einsum('nij,nj->ni', inverses, (background - far)[..., 2])
    inverses = inverses.reshape(-1, 9)
    map_x = np.empty((rows, cols), np.float32)
    map_y = np.empty((rows, cols), np.float32)

    def run(chunk: int) -> None:
        live_places(
            chunk * rows // CHUNKS, (chunk + 1) * rows // CHUNKS, inverses, path.grid.center,
            path.grid.live_shape[0], surface, shifts, map_x, map_y,
        )  # fmt: skip

    list(executor.map(run, range(CHUNKS)))
    return map_x, map_y


def at_places(
    image: np.ndarray, places: tuple[np.ndarray, np.ndarray], interpolation: int
) -> np.ndarray:
    """Sample an image at columns and rows, 0 outside."""
    return cv2.remap(image, *places, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
