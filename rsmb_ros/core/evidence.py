"""How surprising each pixel's residual is, given what the frame itself shows of its noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from ._kernels import evidence as kernels

INTENSITY_BINS = 8
TEXTURE_BINS = 10
FULL_TRUST = 1000  # pixels; a bin with fewer leans on its neighbours
MIN_SIGMA = 1.0  # grey levels
ENOUGH = np.s_[::2, ::2]  # pixels the noise is learned from: neighbours say much the same
RESIDUAL_STEP = 0.25  # grey levels, histogram resolution of absolute residuals
EVIDENCE_WINDOW = 7  # px
MISPLACED = 0.12  # px, by which an edge may be off although its surroundings fit
OUTLINE_WINDOW = 3  # px; where the outline of what is known to be an object is looked for
PLACE_SHARE = np.float32(2.0)  # standard deviations that a row may lie off: all of it does at once
MAX_Z2 = 100.0  # one wild pixel must not decide for its neighbourhood


def gradient_energy(image: np.ndarray) -> np.ndarray:
    """Squared gradient of an image (M, N) float32 [(grey levels / px)^2]."""
    g_x = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8)
    g_y = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=1 / 8)
    return g_x * g_x + g_y * g_y


class Texture(NamedTuple):
    """What of an image decides the noise that it lets expect."""

    energy: np.ndarray  # (M, N) float32 squared gradient [(grey levels / px)^2]
    code: np.ndarray  # (M, N) uint16 grey level times 256, and rms gradient over 5 x 5 px in steps

    @classmethod
    def of(cls, image: np.ndarray) -> Texture:
        """Describe an image (M, N) float32 [grey levels]."""
        energy, code = np.empty(image.shape, np.float32), np.empty(image.shape, np.uint16)
        kernels.describe_rows(0, len(image), np.ascontiguousarray(image), energy, code)
        return cls(energy, code)


@dataclass(frozen=True)
class NoiseTable:
    """
    Standard deviation of the residual by predicted intensity and texture.

    Learned from the frame: 1.48 x median of the absolute residual per bin, so up to half of a bin
    may be changed. Gamma makes dark pixels noisier, JPEG and misregistration textured ones; one
    sigma for the whole frame multiplies the alarms.
    """

    sigma: np.ndarray  # (INTENSITY_BINS, TEXTURE_BINS) float32 [grey levels]
    intensity_bin: np.ndarray  # (256,) float32 place in the table of each intensity
    texture_bin: np.ndarray  # place in the table of each step of texture

    @classmethod
    def learn(cls, texture: Texture, residual: np.ndarray, valid: np.ndarray) -> NoiseTable:
        """Learn from a predicted image, its residual (M, N) [grey levels] and where it holds."""
        levels, steps = np.zeros((2, 256), np.int64)
        kernels.count_codes(texture.code, valid, levels, steps)
        intensity_bin = _equal_share_bins(levels, INTENSITY_BINS)
        texture_bin = _equal_share_bins(steps, TEXTURE_BINS)
        histogram = np.zeros((INTENSITY_BINS * TEXTURE_BINS, 256), np.int64)
        kernels.count_residuals(
            texture.code,
            residual,
            valid,
            np.rint(intensity_bin).astype(np.int64) * TEXTURE_BINS,
            np.rint(texture_bin).astype(np.int64),
            1.0 / RESIDUAL_STEP,
            histogram,
        )
        sigma = 1.4826 * RESIDUAL_STEP * _medians(histogram)
        shape = (INTENSITY_BINS, TEXTURE_BINS)
        # neighbouring bins smooth each other, by what each of them knows
        trust = np.minimum(histogram.sum(axis=1), FULL_TRUST).reshape(shape) + 1e-3
        smooth = cv2.GaussianBlur(trust * sigma.reshape(shape), (3, 3), 0.7)
        table = smooth / cv2.GaussianBlur(trust, (3, 3), 0.7)
        table = np.maximum(table, MIN_SIGMA).astype(np.float32)
        return cls(table, intensity_bin, texture_bin)

    @cached_property
    def variances(self) -> np.ndarray:
        """Variance at each code of a `Texture` (65536,) float32, interpolated in the table."""
        out = np.empty(256 * 256, np.float32)
        kernels.fill_variances(self.sigma, self.intensity_bin, self.texture_bin, out)
        return out

    def __call__(self, texture: Texture, place: np.ndarray | None = None) -> np.ndarray:
        """
        Standard deviation expected at each pixel of a predicted image (M, N) [grey levels].

        `place` (M,) is the standard deviation of each row's place [px].
        """
        edges = misplaced(texture, place)[:, None] * texture.energy
        return np.sqrt(self.variances[texture.code] + edges)

    def surprise(
        self,
        texture: Texture,
        residual: np.ndarray,
        judged: np.ndarray,
        misfit: np.ndarray,
        place: np.ndarray,
    ) -> np.ndarray:
        """
        Square the residual of a predicted image over its noise, (M, N) float32, at most MAX_Z2.

        0 where it is not judged. `misfit` (M, N) says how much larger residuals are there than
        noise, for `place` see above.
        """
        out = np.empty(residual.shape, np.float32)
        kernels.surprise_rows(
            0, len(residual), residual, misfit, judged, texture.code, texture.energy,
            self.variances, misplaced(texture, place), MAX_Z2, out,
        )  # fmt: skip
        return out


def evidence(z: np.ndarray, size: int = EVIDENCE_WINDOW) -> np.ndarray:
    """Root mean square of normalised residuals (M, N) over a small window, float32."""
    return box_rms(np.minimum(z * z, np.float32(MAX_Z2)), size)


def box_rms(squares: np.ndarray, size: int = EVIDENCE_WINDOW) -> np.ndarray:
    """Root of the mean of an image (M, N) float32 over size x size pixels, size odd."""
    out = np.empty(squares.shape, np.float32)
    kernels.box_rms_rows(0, len(squares), np.ascontiguousarray(squares), size // 2, out)
    return out


def misplaced(texture: Texture, place: np.ndarray | None) -> np.ndarray:
    """Variance of the place of each row's edges (M,) float32 [px^2]."""
    still = np.full(len(texture.energy), MISPLACED**2, np.float32)
    return still if place is None else still + (PLACE_SHARE * place.astype(np.float32)) ** 2


def _equal_share_bins(counts: np.ndarray, bins: int) -> np.ndarray:
    """Place 0..bins-1 of each counted value so that every bin gets an equal share of them."""
    share = np.cumsum(counts) / max(1, counts.sum())
    return np.clip(share * bins - 0.5, 0.0, bins - 1.0).astype(np.float32)


def _medians(histogram: np.ndarray) -> np.ndarray:
    """Median of each row of a histogram, in bins, interpolated inside the bin."""
    total = np.cumsum(histogram, axis=1)
    half = total[:, -1:] / 2.0
    at = np.argmax(total >= half, axis=1)
    lines = np.arange(len(histogram))
    inside = np.maximum(histogram[lines, at], 1)
    return at + 1.0 - (total[lines, at] - half[:, 0]) / inside
