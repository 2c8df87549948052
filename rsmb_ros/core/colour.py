"""What changed in colour, where brightness alone does not tell."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .evidence import MAX_Z2, OUTLINE_WINDOW, NoiseTable, Texture, box_rms

WEIGHT = np.float32(0.5)  # of a deviation: cameras keep colours at half the size, and less exactly
WINDOW = 5  # px of the half-size image
SATURATED = np.float32(0.08)  # of a tint that may be lost next to its edges
GREY = 128.0  # of tints without colour, as `cv2.cvtColor` has them
SOME = np.s_[::4, ::4]  # pixels that tell white balance and usual deviation
CLEAR = 6.0  # levels of tint; less is no other colour
CLEARLY = 2.5  # times what most of the frame is off


def tints(image: np.ndarray) -> np.ndarray:
    """Tints C_r, C_b (M, N, 2) float32 of a BGR image (M, N, 3) uint8, 128 = grey."""
    return cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)[..., 1:].astype(np.float32)


@dataclass(frozen=True)
class ColourEvidence:
    """How surprising the colours of a live frame of M x N px are."""

    strength: np.ndarray  # (M, N) float32 [sigma], comparable to that of brightness
    sharp: np.ndarray  # the same over a smaller window
    limit: float  # levels that the tint of a place may be off and still be the same

    @classmethod
    def of(
        cls,
        live: np.ndarray,
        predicted: np.ndarray,
        judged: np.ndarray,
        misfit: np.ndarray,
        place: np.ndarray,
    ) -> ColourEvidence:
        """
        Compare a live frame with its prediction, both BGR (M, N, 3) uint8, at half their size.

        `judged` (M, N) bool, `misfit` (M, N) and `place` (M,) as in `NoiseTable.surprise`.
        """
        rows, cols = judged.shape
        half = (cols // 2, rows // 2)
        seen, known = (
            tints(cv2.resize(image, half, interpolation=cv2.INTER_AREA))
            for image in (live, predicted)
        )
        valid = cv2.resize(judged.view(np.uint8), half, interpolation=cv2.INTER_NEAREST) > 0
        worse = cv2.resize(misfit, half, interpolation=cv2.INTER_NEAREST)
        off = cv2.resize(place[:, None], (1, half[1]))[:, 0] / 2.0
        squares = np.zeros(valid.shape, np.float32)
        limits = [CLEAR]
        for tint, expected in zip(cv2.split(seen), cv2.split(known), strict=True):
            residual = tint - expected
            some = residual[SOME][valid[SOME]]
            if some.size:
                balance = np.median(some)
                residual -= balance
                limits.append(CLEARLY * float(np.percentile(np.abs(some - balance), 90)))
            texture = Texture.of(expected)
            noise = NoiseTable.learn(texture, residual, valid)(texture, off)
            # near edges of rich colours a camera that keeps them at half the size is off by more
            rich = SATURATED * cv2.dilate(cv2.absdiff(expected, GREY), np.ones((5, 5), np.uint8))
            off_by = residual / (cv2.magnitude(noise, rich) * (worse / WEIGHT))
            squares = np.maximum(squares, np.minimum(off_by * off_by, MAX_Z2) * valid)
        strength, sharp = (
            cv2.resize(box_rms(squares, size), (cols, rows), interpolation=cv2.INTER_LINEAR)
            for size in (WINDOW, OUTLINE_WINDOW)
        )
        return cls(strength, sharp, max(limits))


def tint_off(live: np.ndarray, predicted: np.ndarray, mask: np.ndarray) -> float:
    """Return by how many levels most of a mask (M, N) bool has another tint than predicted."""
    off = np.abs(cv2.blur(tints(live) - tints(predicted), (WINDOW, WINDOW))).max(axis=-1)
    return float(np.median(off[mask])) if mask.any() else 0.0
