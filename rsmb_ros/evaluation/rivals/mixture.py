"""
Homography mixtures over the rows.

Grundmann, Kwatra, Castro, Essa, "Calibration-free rolling shutter removal", ICCP 2012: the frame
has K homographies at evenly spaced rows; a row's homography is their Gaussian-weighted mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..methods import Registration
from ..warping import mapped, places_of_row_homographies, registration_at
from .features import Pairs, check_agreement, robust_homography, tracked_corners

BLOCKS = 10  # K
SPREAD = 0.1  # sigma of a block's weight [share of the frame's height]
# weight of the differences between neighbouring blocks, first six numbers and g, h [1 / sqrt(px)]
TIE = (0.3,) * 6 + (3.0,) * 2  # ours
ITERATIONS = 10
LEAST_ERROR = 0.1  # px, bounds a track's weight 1 / error


@dataclass(frozen=True)
class MixtureRegistrar:
    """Mixture of 10 homographies through tracked corners."""

    name: str = 'mixture'

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        pairs = tracked_corners(reference, live)
        start = robust_homography(pairs, live.shape)
        scales = normaliser(live.shape), normaliser(reference.shape)
        blocks = fitted_blocks(pairs, start, scales, live.shape[0])
        weights = row_weights(np.arange(live.shape[0]), live.shape[0])
        rows = in_pixels(np.tensordot(weights, blocks, axes=1), scales)
        return registration_at(places_of_row_homographies(rows, live.shape), reference)


def row_weights(rows: np.ndarray, height: int) -> np.ndarray:
    """Weights w_k of the blocks at n live rows [px] of a frame, (n, K), sum 1 over K."""
    centres = (np.arange(BLOCKS) + 0.5) / BLOCKS
    distance = (rows[:, None] + 0.5) / height - centres
    weights = np.exp(-0.5 * (distance / SPREAD) ** 2)
    return weights / weights.sum(axis=1, keepdims=True)


def normaliser(shape: tuple[int, int]) -> np.ndarray:
    """Homography (3, 3) from pixels to the image centre and half widths."""
    rows, cols = shape
    half = cols / 2
    return np.array([[1 / half, 0, 0.5 / half - 1], [0, 1 / half, (1 - rows) / cols], [0, 0, 1]])


def in_pixels(hs: np.ndarray, scales: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Homographies (..., 3, 3) between normalised places -> between pixels."""
    live, reference = scales
    return np.linalg.inv(reference) @ hs @ live


def fitted_blocks(
    pairs: Pairs, start: np.ndarray, scales: tuple[np.ndarray, np.ndarray], height: int
) -> np.ndarray:
    """
    Fit the blocks to tracks: normalised DLT, reweighted towards the sum of errors.

    Parameters
    ----------
    pairs : Pairs
        n tracks.
    start : ndarray of shape (3, 3)
        Homography from live to reference pixels; gives the first weights.
    scales : tuple of two ndarray of shape (3, 3)
        Normalisers of the live frame and of the reference.
    height : int
        Rows of the live frame.

    Returns
    -------
    ndarray of shape (K, 3, 3), float64
        H_k between normalised places, ``h_33 = 1``.

    Raises
    ------
    NotRegistered
        If too few tracks agree with the result.

    """
    live, reference = scales
    weights = row_weights(pairs.live[:, 1], height)
    places = mapped(live, *pairs.live.T)
    equations, known = _equations(places, mapped(reference, *pairs.reference.T))
    terms = (weights[:, None, :, None] * equations[:, :, None, :]).reshape(len(pairs), 2, -1)
    pixels = 1 / reference[0, 0]  # px of a normalised unit in the reference
    ties = pixels * np.kron(_neighbour_differences(), np.diag(TIE))
    blocks = np.tile(reference @ start @ np.linalg.inv(live), (BLOCKS, 1, 1))
    blocks /= blocks[:, 2:, 2:]
    # DLT's denominator stays that of the start: following it, wrong tracks shrink it to nothing
    depth = np.maximum(places @ blocks[0, 2, :2] + 1, 0.1)
    for _ in range(ITERATIONS):
        errors = np.maximum(_errors(blocks, weights, pairs, scales), LEAST_ERROR)
        trust = (pixels / (np.sqrt(errors) * depth))[:, None, None]
        rows = np.vstack([(trust * terms).reshape(-1, terms.shape[2]), ties])
        values = np.concatenate([(trust[..., 0] * known).ravel(), np.zeros(len(ties))])
        # normal equations: 80 unknowns, well scaled by the normalisers and tied to each other
        solution = np.linalg.solve(rows.T @ rows, rows.T @ values).reshape(BLOCKS, 8)
        blocks = np.hstack([solution, np.ones((BLOCKS, 1))]).reshape(BLOCKS, 3, 3)
    check_agreement(_errors(blocks, weights, pairs, scales))
    return blocks


def _equations(places: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """DLT equations (n, 2, 8) and right sides (n, 2) of normalised places and targets (n, 2)."""
    point = np.hstack([places, np.ones((len(places), 1))])
    equations = np.zeros((len(places), 2, 8))
    equations[:, 0, :3] = equations[:, 1, 3:6] = point
    equations[:, :, 6:] = -targets[:, :, None] * places[:, None, :]
    return equations, targets


def _neighbour_differences() -> np.ndarray:
    """Matrix that takes one number of each block to the differences of neighbours, (K - 1, K)."""
    return np.eye(BLOCKS - 1, BLOCKS) - np.eye(BLOCKS - 1, BLOCKS, 1)


def _errors(
    blocks: np.ndarray, weights: np.ndarray, pairs: Pairs, scales: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Distances (n,) of the mapped tracks from where they were seen [px]."""
    hs = in_pixels(np.tensordot(weights, blocks, axes=1), scales)
    return np.linalg.norm(mapped(hs, *pairs.live.T) - pairs.reference, axis=1)
