"""Gain, bias and defocus of a live frame whose path is known, at all its pixels."""

from __future__ import annotations

import numpy as np

from .photometric import LUMA_WEIGHTS, Light

ROW_STEP = 3  # rows between those that the light is fitted on
STEPS = 15  # of the fit, at most
STANDS = 1e-4  # of each unknown; a smaller step ends the fit
OUTLIER = 4.685  # standard deviations, where Tukey's loss ends
MIN_SIGMA = 0.5  # grey levels
DARKEST = np.float32(0.25)  # linear light that the tone curve starts at


class SeenLight:
    """
    What the live camera shows of light (C, M, N) float32, whatever its exposure and lens.

    Unknowns: gain a_0..a_3 and bias of `photometric.Light`, and the defocus [px^2], of which
    `soft` says what 1 px^2 adds.
    """

    def __init__(self, sharp: np.ndarray, soft: np.ndarray, gamma: float) -> None:
        self._sharp = sharp
        self._soft = soft
        self._gamma = gamma
        self._weights = LUMA_WEIGHTS if len(sharp) == 3 else np.ones(1, np.float32)

    def fitted(self, live: np.ndarray, where: np.ndarray) -> np.ndarray:
        """Return the unknowns (6,) that explain grey levels `live` (M, N) best, by Tukey's loss."""
        unknowns = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        part = np.zeros(where.shape, bool)
        part[::ROW_STEP] = where[::ROW_STEP]
        if not part.any():
            return unknowns
        # x, y, r^2 at each pixel, as the gain's polynomial takes them
        terms = np.stack([Light(row, 0.0).gain_field(where.shape)[part] for row in np.eye(4)])
        sharp, soft, values = self._sharp[:, part], self._soft[:, part], live[part]
        for _ in range(STEPS):
            residual, columns = self._linearised(unknowns, sharp, soft, terms, values)
            sigma = max(MIN_SIGMA, 1.4826 * float(np.median(np.abs(residual))))
            inner = np.maximum(0.0, 1.0 - (residual / (OUTLIER * sigma)) ** 2)
            weighted = columns * inner**2
            step = np.linalg.lstsq(weighted @ columns.T, weighted @ residual, rcond=1e-10)[0]
            unknowns = unknowns + step
            if (np.abs(step) < STANDS).all():
                break
        return unknowns

    def shown(self, unknowns: np.ndarray) -> np.ndarray:
        """Grey levels (M, N) float32 of all pixels."""
        light = Light(unknowns[:4], float(unknowns[4]))
        seen = self._sharp + np.float32(unknowns[5]) * self._soft
        display = light.apply(np.moveaxis(seen, 0, 2), self._gamma)
        return (display @ self._weights).astype(np.float32)

    def _linearised(
        self,
        unknowns: np.ndarray,
        sharp: np.ndarray,
        soft: np.ndarray,
        terms: np.ndarray,
        values: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (n,) and the derivatives (6, n) of the display values."""
        gain = unknowns[:4] @ terms
        shown = np.zeros(len(values))
        columns = np.zeros((6, len(values)))
        for weight, light, softer in zip(self._weights, sharp, soft, strict=True):
            seen = light + unknowns[5] * softer
            linear = np.clip(gain * seen + unknowns[4], DARKEST, 255.0)
            display = weight * 255.0 * (linear / 255.0) ** (1.0 / self._gamma)
            slope = np.where(linear < 255.0, display / (self._gamma * linear), 0.0)
            shown += display
            columns[:4] += terms * (slope * seen)
            columns[4] += slope
            columns[5] += slope * gain * softer
        return values - shown, columns
