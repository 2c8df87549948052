"""One homography for the whole frame, from all intensities (Evangelidis and Psarakis 2008)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..methods import NotRegistered, Registration
from ..warping import places_of_homography, registration_at
from .features import check_outline
from .offset import phase_offset

ITERATIONS = 100
PRECISION = 1e-5  # gain in correlation that ends the iterations
SMOOTHING = 5  # px, side of the Gaussian window, OpenCV's default
MIN_CORRELATION = 0.3  # unrelated images end near 0


@dataclass(frozen=True)
class EccRegistrar:
    """Enhanced correlation coefficient, started by phase correlation."""

    name: str = 'ecc'

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        h, correlation = ecc_homography(reference, live, phase_offset(reference, live))
        if not correlation >= MIN_CORRELATION:  # NaN as well
            raise NotRegistered(f'correlation {correlation:.2f}, need {MIN_CORRELATION}')
        check_outline(h, live.shape)
        return registration_at(places_of_homography(h, live.shape), reference)


def ecc_homography(
    reference: np.ndarray, live: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, float]:
    """
    Homography (3, 3) from live to reference pixels that maximises the correlation, and that.

    Parameters
    ----------
    reference, live : ndarray of shape (M', N') and (M, N), float32
        Grey levels.
    offset : ndarray of shape (2,)
        Start: x, y of reference place - live place [px].

    """
    start = np.eye(3, dtype=np.float32)
    start[:2, 2] = offset
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ITERATIONS, PRECISION)
    try:
        # the live frame is the template: OpenCV's warp leads from template to input
        correlation, h = cv2.findTransformECC(
            live.copy(), reference.copy(), start, cv2.MOTION_HOMOGRAPHY, stop, None, SMOOTHING
        )
    except cv2.error as error:
        raise NotRegistered(f'ECC: {getattr(error, "err", error)}') from error
    return np.asarray(h, np.float64), float(correlation)
