"""The reference and all that is worked out from it once."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from .buffers import Buffers
from .depth_map import DepthMap
from .lens import Lens
from .photometric import luma, to_linear
from .sampling import HALF_PIXELS, half_pixel, side_by_side, softened

CLIPPED = 250  # display value from which on a colour may be anything brighter
NEAR = 16  # px; clipped pixels twice as far from all others are a group of their own

Box = tuple[int, int, int, int]  # columns and rows: left, top, right, bottom (exclusive)


def at_limit(image: np.ndarray) -> np.ndarray:
    """Mark where a colour of an image (M, N) or (M, N, 3) uint8 is clipped, (M, N) bool."""
    return cv2.inRange(image, 0, (CLIPPED - 1,) * 4) == 0


class Reference:
    """
    A clean reference image, prepared on demand.

    Parameters
    ----------
    image : ndarray of shape (M, N) or (M, N, 3), uint8
        Grey or BGR.
    gamma : float
        Tone curve of the camera.
    depth : DepthMap, optional
        Where each pixel lies, if it is known.

    """

    def __init__(self, image: np.ndarray, gamma: float, depth: DepthMap | None = None) -> None:
        self.image = image
        self.gamma = gamma
        self.depth = depth
        self.buffers = Buffers()

    @cached_property
    def grey(self) -> np.ndarray:
        """Grey levels (M, N) float32."""
        return luma(self.image)

    @cached_property
    def contrast(self) -> float:
        """Standard deviation of the grey levels."""
        return float(self.grey.std())

    @cached_property
    def linear(self) -> np.ndarray:
        """Linear light of the grey levels (M, N) float32."""
        return to_linear(self.grey, self.gamma)

    @cached_property
    def fine(self) -> np.ndarray:
        """Half-pixel samples of `linear`, (2M, 2N) float32."""
        return half_pixel(self.linear)

    @cached_property
    def soft(self) -> np.ndarray:
        """What defocus of 1 px^2 adds to `linear`, (M, N) float32."""
        return softened(self.linear, 1.0)

    @cached_property
    def softer(self) -> np.ndarray:
        """Half-pixel samples of `soft`, (2M, 2N) float32."""
        return half_pixel(self.soft)

    @cached_property
    def lens(self) -> Lens:
        """What shows `fine` as a live camera's lens does."""
        return Lens(self.fine, self.softer, self.buffers)

    @cached_property
    def lens_colours(self) -> Lens:
        """What shows `fine_colours` as a live camera's lens does."""
        return Lens(self.fine_colours, self.softer_colours, self.buffers)

    @cached_property
    def fine_clipped(self) -> np.ndarray | None:
        """Half-pixel samples (2M, 2N): 1 at and next to clipped colours, else 0; None: nowhere."""
        clipped = at_limit(self.image).astype(np.uint8)
        if not clipped.any():
            return None
        return half_pixel(cv2.dilate(clipped, np.ones((3, 3), np.uint8)).astype(np.float32))

    @cached_property
    def clipped_boxes(self) -> list[Box]:
        """Boxes that hold all clipped pixels, one for each group of them."""
        clipped = at_limit(self.image).astype(np.uint8)
        near = cv2.dilate(clipped, np.ones((2 * NEAR + 1,) * 2, np.uint8))
        groups = cv2.connectedComponentsWithStats(near)[2][1:]
        return [(x, y, x + width, y + height) for x, y, width, height, _ in groups.tolist()]

    @cached_property
    def fine_grey(self) -> np.ndarray:
        """Half-pixel samples of the grey levels, (2M, 2N) float32."""
        return half_pixel(self.grey)

    @cached_property
    def fine_colours(self) -> np.ndarray:
        """Half-pixel samples of the colours' linear light: `side_by_side`, or `fine` if grey."""
        if self.image.ndim == 2:
            return self.fine
        return side_by_side(self._fine_planes())

    @cached_property
    def softer_colours(self) -> np.ndarray:
        """What defocus of 1 px^2 adds to `fine_colours`."""
        if self.image.ndim == 2:
            return self.softer
        return side_by_side([softened(fine, HALF_PIXELS) for fine in self._fine_planes()])

    def _fine_planes(self) -> list[np.ndarray]:
        """Half-pixel samples of each colour's linear light, (2M, 2N) float32 each."""
        return [
            half_pixel(to_linear(self.image[..., channel].astype(np.float32), self.gamma))
            for channel in range(self.image.shape[2])
        ]
