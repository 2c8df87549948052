"""How surprising each pixel's residual is, given what the frame itself shows of its noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

INTENSITY_BINS = 8
TEXTURE_BINS = 10
FULL_TRUST = 1000  # pixels; a bin with fewer leans on its neighbours
MIN_SIGMA = 1.0  # grey levels
ENOUGH = np.s_[::2, ::2]  # pixels the noise is learned from: neighbours say much the same
RESIDUAL_STEP = 0.25  # grey levels, histogram resolution of absolute residuals
TEXTURE_STEP = 0.125  # grey levels / px, table resolution
TEXTURE_WINDOW = 5  # px
EVIDENCE_WINDOW = 7  # px
MISPLACED = 0.12  # px, by which an edge may be off although its surroundings fit
OUTLINE_WINDOW = 3  # px; where the outline of what is known to be an object is looked for
PLACE_SHARE = np.float32(2.0)  # standard deviations that a row may lie off: all of it does at once
MAX_Z2 = 100.0  # one wild pixel must not decide for its neighbourhood


def texture(image: np.ndarray) -> np.ndarray:
    """Local rms gradient of an image (M, N) float32 [grey levels / px]."""
    return _texture(gradient_energy(image))


def gradient_energy(image: np.ndarray) -> np.ndarray:
    """Squared gradient of an image (M, N) float32 [(grey levels / px)^2]."""
    g_x = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=1 / 8)
    g_y = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=1 / 8)
    return g_x * g_x + g_y * g_y


def _texture(energy: np.ndarray) -> np.ndarray:
    # the running sums of a box filter may end a rounding below 0
    return np.sqrt(np.maximum(cv2.blur(energy, (TEXTURE_WINDOW, TEXTURE_WINDOW)), 0.0))


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
    texture_bin: np.ndarray  # place in the table of each multiple of TEXTURE_STEP

    @classmethod
    def learn(cls, predicted: np.ndarray, residual: np.ndarray, valid: np.ndarray) -> NoiseTable:
        """Learn from a predicted image (M, N), its residual [grey levels] and where it holds."""
        levels, steps = _quantised(predicted[ENOUGH], texture(predicted)[ENOUGH])
        chosen = valid[ENOUGH].ravel()
        levels, steps = levels.ravel()[chosen], steps.ravel()[chosen]
        intensity_bin = _equal_share_bins(levels, 256, INTENSITY_BINS)
        texture_bin = _equal_share_bins(steps, 256, TEXTURE_BINS)
        bins = np.rint(intensity_bin).astype(np.int64)[levels] * TEXTURE_BINS
        bins += np.rint(texture_bin).astype(np.int64)[steps]
        heights = np.abs(residual[ENOUGH]).ravel()[chosen] / RESIDUAL_STEP
        heights = np.minimum(heights, 255.0).astype(np.int64)
        count = INTENSITY_BINS * TEXTURE_BINS
        histogram = np.bincount(bins * 256 + heights, minlength=count * 256).reshape(count, 256)
        sigma = 1.4826 * RESIDUAL_STEP * _medians(histogram)
        shape = (INTENSITY_BINS, TEXTURE_BINS)
        # neighbouring bins smooth each other, by what each of them knows
        trust = np.minimum(histogram.sum(axis=1), FULL_TRUST).reshape(shape) + 1e-3
        smooth = cv2.GaussianBlur(trust * sigma.reshape(shape), (3, 3), 0.7)
        table = smooth / cv2.GaussianBlur(trust, (3, 3), 0.7)
        table = np.maximum(table, MIN_SIGMA).astype(np.float32)
        return cls(table, intensity_bin, texture_bin)

    def __call__(self, predicted: np.ndarray, place: np.ndarray | None = None) -> np.ndarray:
        """
        Standard deviation expected at each pixel of a predicted image (M, N) [grey levels].

        `place` (M,) is the standard deviation of each row's place [px].
        """
        energy = gradient_energy(predicted)
        levels, steps = _quantised(predicted, _texture(energy))
        sigma = cv2.remap(
            self.sigma,
            self.texture_bin[steps],
            self.intensity_bin[levels],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        misplaced = np.float32(MISPLACED**2)
        if place is not None:
            misplaced = misplaced + ((PLACE_SHARE * place) ** 2)[:, None]
        return np.sqrt(sigma * sigma + misplaced * energy)


def evidence(z: np.ndarray, size: int = EVIDENCE_WINDOW) -> np.ndarray:
    """Root mean square of normalised residuals (M, N) over a small window, float32."""
    window = (size, size)
    return np.sqrt(np.maximum(cv2.blur(np.minimum(z * z, np.float32(MAX_Z2)), window), 0.0))


def _quantised(predicted: np.ndarray, strength: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    levels = np.clip(predicted, 0.0, 255.0).astype(np.uint8)
    return levels, np.minimum(strength / TEXTURE_STEP, 255.0).astype(np.uint8)


def _equal_share_bins(values: np.ndarray, size: int, bins: int) -> np.ndarray:
    """Place 0..bins-1 of each value 0..size-1 so that every bin gets an equal share of `values`."""
    share = np.cumsum(np.bincount(values, minlength=size)) / max(1, values.size)
    return np.clip(share * bins - 0.5, 0.0, bins - 1.0).astype(np.float32)


def _medians(histogram: np.ndarray) -> np.ndarray:
    """Median of each row of a histogram, in bins, interpolated inside the bin."""
    total = np.cumsum(histogram, axis=1)
    half = total[:, -1:] / 2.0
    at = np.argmax(total >= half, axis=1)
    lines = np.arange(len(histogram))
    inside = np.maximum(histogram[lines, at], 1)
    return at + 1.0 - (total[lines, at] - half[:, 0]) / inside
