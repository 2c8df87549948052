"""
Planar motion along a Bezier curve over the rows, from matched blocks.

Liang, Chang, Chen, "Analysis and compensation of rolling shutter effect", IEEE TIP 17(8), 2008, for
two frames: the dominant motion of each band of rows supports one cubic curve over the row index.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from ..methods import NotRegistered, Registration
from ..warping import pixel_grid, registration_at
from .offset import phase_offset

BLOCK = 24  # px, side of a square block
STEP_X = 24  # px between blocks
BAND = 16  # px between bands of blocks; they overlap
MIN_CONTRAST = 4.0  # grey levels, standard deviation; flatter blocks are skipped
SEARCH = 0.05  # of the frame's width, farthest motion from the start offset
MIN_SEARCH = 16  # px
MIN_PEAK = 0.7  # normalised correlation of a block that counts
MIN_BLOCKS = 30
MIN_FOUND = 0.4  # share of the textured blocks; smooth textures match anything now and then
MIN_BANDS = 6
NOT_FOUND = np.full(2, np.nan)
LOSS_PX = 0.5  # bands farther from the curve count less


@dataclass(frozen=True)
class BlockMotions:
    """Motion of n blocks of the live frame; NaN where a textured block was not found."""

    row: np.ndarray  # (n,) float64, centre row [px]
    shift: np.ndarray  # (n, 2) float64, x, y of reference place - live place [px]


@dataclass(frozen=True)
class LiangRegistrar:
    """A translation per row."""

    name: str = 'liang'

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        motions = block_motions(reference, live, phase_offset(reference, live))
        rows, shifts = dominant_motions(motions)
        height = live.shape[0]
        control = fitted_bezier(rows / height, shifts)
        curve = bezier(control, np.arange(height) / height)
        x, y = pixel_grid(live.shape)
        places = np.stack(
            [x + curve[:, :1], np.broadcast_to(y + curve[:, 1:], live.shape)], axis=-1
        )
        return registration_at(places, reference)


def block_motions(reference: np.ndarray, live: np.ndarray, offset: np.ndarray) -> BlockMotions:
    """
    Match blocks of the live frame against the reference around an offset.

    Parameters
    ----------
    reference, live : ndarray of shape (M', N') and (M, N), float32
        Grey levels.
    offset : ndarray of shape (2,)
        Start: x, y of reference place - live place [px].

    """
    reach = max(MIN_SEARCH, round(SEARCH * live.shape[1]))
    start = np.rint(offset).astype(int)
    rows, shifts = [], []
    for top in range(0, live.shape[0] - BLOCK + 1, BAND):
        for left in range(0, live.shape[1] - BLOCK + 1, STEP_X):
            block = live[top : top + BLOCK, left : left + BLOCK]
            if block.std() < MIN_CONTRAST:
                continue
            corner = np.array([left, top])
            low = np.maximum(start + corner - reach, 0)
            high = np.minimum(start + corner + BLOCK + reach, reference.shape[::-1])
            if (high - low < BLOCK + 2).any():
                continue  # outside the reference
            window = reference[low[1] : high[1], low[0] : high[0]]
            scores = cv2.matchTemplate(window, block, cv2.TM_CCOEFF_NORMED)
            scores = np.nan_to_num(scores, posinf=0.0, neginf=0.0)
            rows.append(top + (BLOCK - 1) / 2)
            shifts.append(low + sub_pixel_peak(scores) - corner)
    return BlockMotions(np.array(rows), np.array(shifts).reshape(-1, 2))


def sub_pixel_peak(scores: np.ndarray) -> np.ndarray:
    """Place x, y of the largest score, by a parabola per direction; NaN at the rim or if low."""
    row, col = np.unravel_index(int(scores.argmax()), scores.shape)
    peak = float(scores[row, col])
    at_rim = row in (0, scores.shape[0] - 1) or col in (0, scores.shape[1] - 1)
    if at_rim or not MIN_PEAK <= peak <= 1.001:  # flat windows score anything
        return NOT_FOUND
    sides = [scores[row, [col - 1, col + 1]], scores[[row - 1, row + 1], col]]
    steps = [
        0.5 * (after - before) / max(2 * peak - before - after, 1e-9)
        for before, after in np.array(sides, np.float64)
    ]
    return np.array([col, row]) + np.clip(steps, -0.5, 0.5)


def dominant_motions(motions: BlockMotions) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the median motion of each band: centre rows (b,) and shifts (b, 2), both [px].

    Raises
    ------
    NotRegistered
        If too few blocks were found, or in too few bands.

    """
    found = np.isfinite(motions.shift[:, 0])
    rows, shifts = motions.row[found], motions.shift[found]
    bands = np.unique(rows)
    need = max(MIN_BLOCKS, round(MIN_FOUND * len(found)))
    if len(rows) < need or len(bands) < MIN_BANDS:
        raise NotRegistered(
            f'{len(rows)} of {len(found)} blocks matched in {len(bands)} bands, '
            f'need {need} in {MIN_BANDS}'
        )
    return bands, np.array([np.median(shifts[rows == band], axis=0) for band in bands])


def bezier_weights(t: np.ndarray) -> np.ndarray:
    """Weights (n, 4) of the control points of a cubic Bezier curve at t (n,), 0..1."""
    s = 1 - t
    return np.stack([s**3, 3 * s**2 * t, 3 * s * t**2, t**3], axis=1)


def bezier(control: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points (n, 2) of a cubic Bezier curve with control points (4, 2) at t (n,), 0..1."""
    return bezier_weights(t) @ control


def fitted_bezier(t: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Control points (4, 2) [px] of the curve through shifts (b, 2) [px] at t (b,), robustly."""
    weights = bezier_weights(t)
    start = np.linalg.lstsq(weights, shifts, rcond=None)[0]

    def errors(control: np.ndarray) -> np.ndarray:
        return (weights @ control.reshape(4, 2) - shifts).ravel()

    jacobian = np.kron(weights, np.eye(2))
    found = least_squares(
        errors,
        start.ravel(),
        jac=lambda _: jacobian.copy(),  # old SciPy (1.11) writes weights into it
        loss='soft_l1',
        f_scale=LOSS_PX,
    )
    return found.x.reshape(4, 2)
