"""Whether a registered image shows the same scene as the live one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ._kernels.pixels import block_moments, some_gradients

BLOCKS_ACROSS = 20  # blocks over the image's width
MIN_CONTRAST = 3.0  # grey levels of a block that is asked
MIN_CORRELATION = 0.6  # of a block that agrees
MIN_BLOCKS = 4
ALL = 0.999  # of a block that must lie in the reference
SHARP_SHARE = 95  # percentile of the gradients that stands for an image's sharpness
# Registered / live, where they agree: on right frames 0.87 to 1.0, in blur or across 80 px of
# parallax 0.73 and more; below 0.56 on smeared ones.
MIN_SHARPNESS = 0.6


@dataclass(frozen=True)
class Agreement:
    """Which blocks of a predicted image show what the live one shows."""

    asked: np.ndarray  # (r, c) bool, blocks with texture
    agreed: np.ndarray  # (r, c) bool, those of them whose grey levels correlate
    size: int  # of a block [px]
    bands: np.ndarray  # (r,) correlation of all blocks beside each other, NaN where none is known

    @property
    def share(self) -> float | None:
        """Share of the textured blocks that agree, 0..1; None when too few have texture."""
        asked = np.count_nonzero(self.asked)
        return np.count_nonzero(self.agreed) / asked if asked >= MIN_BLOCKS else None

    def within(self, mask: np.ndarray) -> np.ndarray:
        """Return what of a mask (M, N) bool lies in blocks that agree."""
        agreed = self.agreed.repeat(self.size, axis=0).repeat(self.size, axis=1)
        rows, columns = agreed.shape
        inside = np.zeros_like(mask)
        inside[:rows, :columns] = mask[:rows, :columns] & agreed
        return inside

    def without(self, rows: np.ndarray) -> Agreement:
        """Return what agrees where no block in some `rows` (M,) bool of the images does."""
        bands = rows[: len(self.agreed) * self.size].reshape(-1, self.size).any(axis=1)
        return replace(self, agreed=self.agreed & ~bands[:, None])


@dataclass(frozen=True)
class Likeness:
    """How alike a frame and its prediction are."""

    found: Agreement
    sharpness: float  # of the prediction over the frame's, where they agree, see `sharpness`


def agreement(
    predicted: np.ndarray, live: np.ndarray, complete: np.ndarray, across: int = BLOCKS_ACROSS
) -> Agreement:
    """
    Compare predicted and live grey levels block by block.

    Blocks vote one each, so a large change or strong light in one place cannot decide. Images are
    (M, N) float32, `complete` (M, N) bool; `across` blocks are as wide as they.
    """
    size = block_size(predicted.shape[1], across)
    means = np.empty((predicted.shape[0] // size, predicted.shape[1] // size, 6))
    block_moments(predicted, live, complete, size, means)
    mean_p, mean_l, square_p, square_l, product, known = np.moveaxis(means, -1, 0)
    var_p, var_l, both = square_p - mean_p**2, square_l - mean_l**2, product - mean_p * mean_l
    inside = known > ALL
    asked = inside & (np.maximum(var_p, var_l) > MIN_CONTRAST**2)
    correlation = both / np.sqrt(np.maximum(var_p * var_l, 1e-6))
    common, power_p, power_l = (
        np.where(inside, one, 0.0).sum(axis=1) for one in (both, var_p, var_l)
    )
    bands = common / np.sqrt(np.maximum(power_p * power_l, 1e-6))
    bands[~inside.any(axis=1)] = np.nan
    return Agreement(asked, asked & (correlation > MIN_CORRELATION), size, bands)


def block_size(columns: int, across: int = BLOCKS_ACROSS) -> int:
    """Return the side of a block of an image that so many are across [px]."""
    return max(8, columns // across)


def sharpness(predicted: np.ndarray, live: np.ndarray, judged: np.ndarray) -> float:
    """
    Sharpness of a predicted image relative to the live one, about 1 where they fit.

    A wrong path with a long exposure smears the reference until little contradicts the live frame:
    its agreement is high, its sharpness is not. Images are (M, N) float32, `judged` (M, N) bool, at
    best where they agree: a new object has edges that only the live one shows. They are compared
    at half size, where noise is no texture.
    """
    half = (predicted.shape[1] // 2, predicted.shape[0] // 2)
    whole = np.s_[: 2 * half[1], : 2 * half[0]]
    chosen = judged[whole][::2, ::2]  # in the corner of each pixel of half the size

    def sharp_parts(image: np.ndarray) -> float:
        smaller = cv2.resize(image[whole], half, interpolation=cv2.INTER_AREA)
        energies = np.empty(chosen.size, np.float32)
        return _largest(energies[: some_gradients(smaller, chosen, energies)])

    return float(np.sqrt(sharp_parts(predicted) / max(sharp_parts(live), 1e-6)))


def _largest(values: np.ndarray) -> float:
    """Return what SHARP_SHARE % of `values` (n,) do not exceed, NaN if there are none."""
    if not values.size:
        return float('nan')
    # np.percentile would take ten times as long to find a place between two values
    at = int((values.size - 1) * SHARP_SHARE / 100)
    return float(np.partition(values, at)[at])


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Normalised correlation of two images or parts of them (n,), 0 where one of them is even."""
    a, b = a - a.mean(), b - b.mean()
    spread = float(np.dot(a, a)), float(np.dot(b, b))
    if min(spread) < 1e-6 * a.size:
        return 0.0
    return float(np.dot(a, b)) / (spread[0] * spread[1]) ** 0.5
