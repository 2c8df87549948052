"""Render the registered and the rectified image from a known path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ._kernels.render import blur_rows, live_places, show_rows
from .motion import CameraPath
from .photometric import LUMA_WEIGHTS, Light
from .workers import Workers, shared

STEP_PX = 1.0  # px the reference moves between two instants of the exposure
ONE_WEIGHT = np.ones(1, np.float32)  # of the only plane of a grey image


@dataclass(frozen=True)
class Window:
    """Rows top..bottom and columns left..right (exclusive) of the live frame [px]."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.bottom - self.top, self.right - self.left

    @property
    def area(self) -> int:
        """Pixels of it."""
        return math.prod(self.shape)

    @property
    def box(self) -> tuple[slice, slice]:
        """Index of the window in an image."""
        return np.s_[self.top : self.bottom, self.left : self.right]


def blurred(
    fine: np.ndarray,
    path: CameraPath,
    executor: Workers,
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
    executor : Workers
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
    window = window or whole(path)
    image = np.empty(window.shape, np.float32)
    complete = np.empty(window.shape, bool)
    samples, places = _instants(path, relative_depth, step_px)
    flat = fine.ravel()

    def run(first: int, last: int) -> None:
        blur_rows(
            window.top + first, window.top + last, window.top, window.left, window.right, flat,
            *fine.shape, path.row_times, samples, *places, image, complete,
        )  # fmt: skip

    shared(executor, run, len(image), image.size)
    return image, complete


class Shown(NamedTuple):
    """What the live camera shows of the reference."""

    grey: np.ndarray  # (M, N) float32 grey levels
    colours: np.ndarray | None  # (M, N[, 3]) uint8 display values, 0 where not complete, or None
    complete: np.ndarray  # (M, N) bool, where the reference covers the whole exposure


def shown(
    fine: np.ndarray,
    path: CameraPath,
    light: Light,
    gamma: float,
    executor: Workers,
    relative_depth: float = 1.0,
    window: Window | None = None,
) -> Shown:
    """
    Warp and blur the reference as `blurred` does, and show it in the light of the live frame.

    Colours mix in a blur, each in its own light: grey levels of a mixture are not a mixture.

    Parameters
    ----------
    fine : ndarray of shape (2 rows, 2 cols) or (2 rows, 2, cols, 3), float32
        Reference from `sampling.half_pixel` or `sampling.side_by_side`, linear light.
    path : CameraPath
        Motion of the live camera.
    light : Light
        Of the live frame.
    gamma : float
        Tone curve of the camera.
    executor : Workers
        Threads that share the rows.
    relative_depth : float
        ``d_l`` of the layer that is rendered, background = 1.
    window : Window, optional
        Part of the live frame; default all of it.

    """
    window = window or whole(path)
    channels = fine.shape[3:]
    weights = LUMA_WEIGHTS if channels else ONE_WEIGHT
    grey = np.empty(window.shape, np.float32)
    colours = np.empty((*window.shape, *channels), np.uint8)
    complete = np.empty(window.shape, bool)
    samples, places = _instants(path, relative_depth, STEP_PX)
    width = window.right - window.left
    pixel = np.repeat(np.arange(width, dtype=np.float32), len(weights)) if channels else None
    flat, apart = fine.ravel(), colours.reshape(len(grey), width * len(weights))
    half_columns = 2 * path.grid.reference_shape[1]

    def run(first: int, last: int) -> None:
        show_rows(
            window.top + first, window.top + last, window.top, window.left, window.right, flat,
            len(fine), half_columns, path.row_times, samples, *places, pixel, light.gain,
            light.bias, gamma, weights, grey, apart, complete,
        )  # fmt: skip

    shared(executor, run, len(grey), grey.size)
    return Shown(grey, colours, complete)


def whole(path: CameraPath) -> Window:
    """Return the window that is the live frame."""
    rows, cols = path.grid.live_shape
    return Window(0, rows, 0, cols)


def _instants(path: CameraPath, relative_depth: float, step_px: float) -> tuple[np.ndarray, tuple]:
    """Return how many instants each row needs, and what kernels take to place them."""
    samples = path.samples_per_row(step_px, stretch=max(1.0, 1.0 / relative_depth))
    return samples, (
        path.control, path.first_time, path.knot_rows, path.exposure_rows, path.grid.focal_px,
        path.grid.center, 1.0 / relative_depth,
    )  # fmt: skip


def rectified(live: np.ndarray, path: CameraPath, executor: Workers) -> np.ndarray:
    """
    Bring a live image back to the reference's grid through each row's centroid pose.

    Rolling shutter is undone, blur is not. `live` is (M, N) or (M, N, 3) uint8; pixels that the
    live frame does not show are 0.
    """
    return at_places(live, shown_at(path, executor), cv2.INTER_CUBIC)


def shown_at(
    path: CameraPath, executor: Workers, surface: np.ndarray | None = None
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

    def run(first: int, last: int) -> None:
        live_places(
            first, last, inverses, path.grid.center, path.grid.live_shape[0], surface, shifts,
            map_x, map_y,
        )  # fmt: skip

    shared(executor, run, rows, rows * cols)
    return map_x, map_y


def at_places(
    image: np.ndarray, places: tuple[np.ndarray, np.ndarray], interpolation: int
) -> np.ndarray:
    """Sample an image at columns and rows, 0 outside."""
    return cv2.remap(image, *places, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
