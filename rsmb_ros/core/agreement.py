"""Whether a registered image shows the same scene as the live one."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial

import cv2
import numpy as np

from ._kernels.pixels import block_moments
from .evidence import ENOUGH, gradient_energy
from .workers import beside

BLOCKS_ACROSS = 20  # blocks over the image's width
MIN_CONTRAST = 3.0  # grey levels of a block that is asked
MIN_CORRELATION = 0.6  # of a block that agrees
MIN_BLOCKS = 4
SHARP_SHARE = 95  # percentile of the gradients that stands for an image's sharpness
MIN_SHARPNESS = 0.6  # registered / live; 0.93 to 1.0 on right frames, below 0.45 on smeared ones


def agreement(
    predicted: np.ndarray, live: np.ndarray, complete: np.ndarray, across: int = BLOCKS_ACROSS
) -> float | None:
    """
    Share of textured blocks whose predicted and live grey levels correlate, 0..1.

    Blocks vote one each, so a large change or strong light in one place cannot decide. Images are
    (M, N) float32, `complete` (M, N) bool; `across` blocks are as wide as they. None when too few
    blocks have texture.
    """
    size = block_size(predicted.shape[1], across)
    means = np.empty((predicted.shape[0] // size, predicted.shape[1] // size, 6))
    block_moments(predicted, live, complete, size, means)
    mean_p, mean_l, square_p, square_l, product, known = np.moveaxis(means, -1, 0)
    full = known > 0.999
    var_p, var_l, both = square_p - mean_p**2, square_l - mean_l**2, product - mean_p * mean_l
    asked = full & (np.maximum(var_p, var_l) > MIN_CONTRAST**2)
    if np.count_nonzero(asked) < MIN_BLOCKS:
        return None
    correlation = both[asked] / np.sqrt(np.maximum(var_p[asked] * var_l[asked], 1e-6))
    return float((correlation > MIN_CORRELATION).mean())


def block_size(columns: int, across: int = BLOCKS_ACROSS) -> int:
    """Return the side of a block of an image that so many are across [px]."""
    return max(8, columns // across)


def sharpness(
    predicted: np.ndarray, live: np.ndarray, judged: np.ndarray, executor: Executor
) -> float:
    """
    Sharpness of a predicted image relative to the live one, about 1 where they fit.

    A wrong path with a long exposure smears the reference until little contradicts the live frame:
    its agreement is high, its sharpness is not. Images are (M, N) float32, `judged` (M, N) bool;
    they are compared at half size, where noise is no texture. Each is looked at by a thread.
    """
    half = (predicted.shape[1] // 2, predicted.shape[0] // 2)
    whole = np.s_[: 2 * half[1], : 2 * half[0]]
    chosen = judged[whole][ENOUGH]

    def sharp_parts(image: np.ndarray) -> float:
        smaller = cv2.resize(image[whole], half, interpolation=cv2.INTER_AREA)
        return _largest(gradient_energy(smaller)[chosen])

    waited = beside(executor, partial(sharp_parts, predicted))
    seen = sharp_parts(live)
    return float(np.sqrt(waited() / max(seen, 1e-6)))


def _largest(values: np.ndarray) -> float:
    """Return what SHARP_SHARE % of `values` (n,) do not exceed, NaN if there are none."""
    if not values.size:
        return float('nan')
    # np.percentile would take ten times as long to find a place between two values
    at = int((values.size - 1) * SHARP_SHARE / 100)
    return float(np.partition(values, at)[at])
