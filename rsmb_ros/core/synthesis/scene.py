"""What the camera looks at: textured planes, the ground first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsmb_ros.core._kernels.synthesis import GONE, NEW, STATIC

__all__ = ['GONE', 'NEW', 'STATIC', 'Scene', 'Sheet']


@dataclass(frozen=True)
class Sheet:
    """
    A textured plane parallel to the image: a layer, an object lying on the ground, a shadow.

    A shadow is a black sheet whose alpha is the share of light it takes.
    """

    texture: np.ndarray  # (R, C) or (R, C, 3) uint8, display values
    cover: np.ndarray  # (R, C) float32, alpha 0..1
    x: float  # column of the texture's left edge in the reference [px], may be negative
    y: float  # row of the texture's top edge in the reference [px]
    relative_depth: float = 1.0  # d_l, background = 1
    name: str = ''
    kind: int = STATIC  # STATIC: in both images, NEW: in the live one, GONE: in the reference
    shadow: bool = False  # of light, nothing to touch: neither a change nor none in the truth


@dataclass(frozen=True)
class Scene:
    """Ground and static layers. Sheets later in a list hide earlier ones."""

    background: np.ndarray  # (R, C) or (R, C, 3) uint8; reference + `margin` on each side
    margin: int  # px of background beyond each edge of the reference
    layers: tuple[Sheet, ...] = ()  # static, in the reference too

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the reference [px]."""
        rows, cols = self.background.shape[:2]
        return rows - 2 * self.margin, cols - 2 * self.margin
