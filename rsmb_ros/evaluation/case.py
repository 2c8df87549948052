"""One pair of images with what is true of it: what every method is measured on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class TrueMotion:
    """How a synthetic live frame of M x N px was taken."""

    places: np.ndarray  # (M, N, 2) float32, x, y in the reference of each pixel's exposure [px]
    centroids: np.ndarray  # (M, 6) float64, centroid pose tau_c of each row, see MOTION_COLUMNS
    layers: np.ndarray  # (M, N) uint8, 0 background, n: n-th entry of `depths`; what is in front
    depths: tuple[float, ...]  # relative depth of layers 1, 2, ..., background = 1
    exposure_rows: float  # t_e / t_d [rows]
    path: np.ndarray | None = None  # (T, 6) poses at row times path_start, path_start + 1, ...
    path_start: int = 0  # [rows]
    clean: np.ndarray | None = None  # (M, N[, 3]) float32 display values, no objects, no noise


@dataclass(frozen=True)
class Case:
    """A reference, a live frame and the truth. Images are uint8, grey or BGR."""

    name: str  # 'planar/07'
    reference: np.ndarray  # (M', N') or (M', N', 3)
    live: np.ndarray  # (M, N) or (M, N, 3)
    label: np.ndarray  # (M, N) uint8, CDnet: 255 changed, 0 not, 170 rim, 85 outside
    objects: np.ndarray  # (M, N) uint8, number of the changed object a pixel belongs to, 0: none
    focal_px: float | None = None  # None: unknown
    motion: TrueMotion | None = None  # None: real motion, nobody knows it
    about: Mapping[str, object] = field(default_factory=dict)  # settings it was made with

    @property
    def changed(self) -> bool:
        """Whether anything has changed."""
        return bool(self.objects.any())
