"""How well a frame fits, as texts for diagnostics."""

from __future__ import annotations

import math

import cv2
import numpy as np

from rsmb_ros.core.types import Result


def quality(result: Result | None) -> dict[str, str]:
    """Return mean residual where judged, median uncertainty of rows and the share judged."""
    mean = uncertainty = judged = math.nan
    if result is not None:
        valid = cv2.countNonZero(result.valid_mask)
        judged = 100.0 * valid / result.valid_mask.size
        if valid:  # elsewhere the residual is 0
            mean = cv2.norm(result.residual, cv2.NORM_L1) / valid
        known = result.row_uncertainty[np.isfinite(result.row_uncertainty)]
        uncertainty = float(np.median(known)) if known.size else math.nan
    return {
        'residual mean [grey levels]': known_number(mean, 2),
        'row uncertainty median [px]': known_number(uncertainty, 3),
        'judged [%]': known_number(judged, 1),
    }


def known_number(value: float, digits: int) -> str:
    """Return a number with so many digits; '' if it is not known."""
    return f'{value:.{digits}f}' if math.isfinite(value) else ''
