"""The reference as sharp as the lens of a live camera shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .buffers import Buffers
from .sampling import defocused
from .workers import Workers

# px^2 between the lenses that a reference is seen through: half of it away, a rendered image is
# off by 0.03 to 0.15 grey levels rms.
LENS_STEP = 0.01


class Glass:
    """A lens of some strength: for as long as one is kept, so is what was seen through it."""


@dataclass(frozen=True)
class Seen:
    """A reference through a lens."""

    variance: float  # of the lens's blur, over the reference's [px^2]
    fine: np.ndarray  # (2M, ...) float32, linear light
    glass: Glass


class Lens:
    """
    Shows a reference through lenses, of which the last is remembered: frames of a camera agree.

    Parameters
    ----------
    fine : ndarray of shape (2M, ...), float32
        Half-pixel samples of linear light.
    softer : ndarray, float32
        What defocus of 1 px^2 adds to it.
    buffers : Buffers
        Where arrays like `fine` come from.

    """

    def __init__(self, fine: np.ndarray, softer: np.ndarray, buffers: Buffers) -> None:
        self._sharp = Seen(0.0, fine, Glass())
        self._softer = softer
        self._buffers = buffers
        self._last = self._sharp

    def seen(self, variance: float, executor: Workers) -> Seen:
        """Return the reference with about that defocus [px^2], the same whatever was asked last."""
        near = LENS_STEP * round(variance / LENS_STEP)
        if near == 0.0:
            return self._sharp
        if near != self._last.variance:
            self._last = self._sharp  # so that its array may be used again
            self._last = self._through(near, executor)
        return self._last

    def _through(self, variance: float, executor: Workers) -> Seen:
        fine, glass = self._sharp.fine, Glass()
        out = self._buffers.lend(glass, fine.shape)

        return Seen(variance, defocused(fine, self._softer, variance, executor, out), glass)
