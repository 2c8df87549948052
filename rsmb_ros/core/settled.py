"""Results that need nothing of the detector any more: they may travel to another process."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .types import Result


@dataclass(frozen=True)
class SettledViews:
    """Views that are images already."""

    registered_image: np.ndarray
    rectified_image: np.ndarray

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it."""
        return self.registered_image

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference."""
        return self.rectified_image


def settled(result: Result) -> Result:
    """Return the result with its views computed and without times: equal frames, equal results."""
    return replace(result, timings_ms={}, views=SettledViews(result.registered, result.rectified))
