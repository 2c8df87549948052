"""Intrinsics of the live camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import ConfigError

GUESSED_FOCAL = 0.9  # x width: a 58 degree lens, the middle of common drone cameras


@dataclass(frozen=True)
class Camera:
    """
    Pinhole intrinsics K with square pixels.

    The principal point is taken at the image centre: an error of some pixels only shifts what is
    called translation and what rotation, never where a row lands.
    """

    focal_px: float  # focal length [px]
    guessed: bool = False  # True: nobody gave a focal length

    def __post_init__(self) -> None:
        if not (math.isfinite(self.focal_px) and self.focal_px > 0):
            raise ConfigError(f'focal length = {self.focal_px!r} px must be above 0')

    @classmethod
    def guess(cls, width: int) -> Camera:
        """Return a camera with a usual field of view for an image of `width` px."""
        return cls(GUESSED_FOCAL * width, guessed=True)
