"""Light: display values against linear light, and the gain between two exposures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ._kernels.pixels import mix_colours

# ITU-R BT.601 weights of B, G, R, as every camera's JPEG uses for its luma.
LUMA_WEIGHTS = np.array([0.114, 0.587, 0.299], np.float32)


def luma(image: np.ndarray) -> np.ndarray:
    """Grey levels of a (M, N) or BGR (M, N, 3) image, (M, N) float32, 0..255."""
    if image.ndim == 2:
        return image.astype(np.float32)
    grey = np.empty(image.shape[:2], np.float32)
    mix_colours(np.ascontiguousarray(image).reshape(-1), LUMA_WEIGHTS, grey.reshape(-1))
    return grey


def to_linear(display: np.ndarray, gamma: float) -> np.ndarray:
    """Display values 0..255 -> linear light 0..255: 255 (v / 255)^gamma, float32."""
    return (np.float32(255.0) * (display / np.float32(255.0)) ** np.float32(gamma)).astype(
        np.float32
    )


def to_display(linear: np.ndarray, gamma: float) -> np.ndarray:
    """Linear light -> display values, clipped to 0..255, float32; inverse of `to_linear`."""
    share = np.clip(linear, 0.0, 255.0) / np.float32(255.0)
    return (np.float32(255.0) * share ** np.float32(1.0 / gamma)).astype(np.float32)


@dataclass(frozen=True)
class Light:
    """
    Light of the live frame relative to the reference, in linear light.

    live = (a_0 + a_1 x + a_2 y + a_3 (x^2 + y^2)) reference + bias, with x, y from the image centre
    in half widths: auto-exposure, vignetting and haze.
    """

    gain: np.ndarray  # (4,) float64, a_0..a_3
    bias: float  # grey levels of linear light

    @classmethod
    def same(cls) -> Light:
        """Return the light of two equal exposures."""
        return cls(np.array([1.0, 0.0, 0.0, 0.0]), 0.0)

    def gain_field(self, shape: tuple[int, int]) -> np.ndarray:
        """Gain at every pixel of a frame of `shape` (M, N), float32."""
        rows, cols = shape
        x = (np.arange(cols, dtype=np.float32) - (cols - 1) / 2) / (cols / 2)
        y = ((np.arange(rows, dtype=np.float32) - (rows - 1) / 2) / (cols / 2))[:, None]
        a = self.gain.astype(np.float32)
        return a[0] + a[1] * x + a[2] * y + a[3] * (x * x + y * y)

    def apply(self, linear: np.ndarray, gamma: float) -> np.ndarray:
        """Linear light of the reference (M, N[, 3]) -> display values of the live frame."""
        field = self.gain_field(linear.shape[:2])
        if linear.ndim == 3:
            field = field[..., None]
        return to_display(linear * field + np.float32(self.bias), gamma)
