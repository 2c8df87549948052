"""Dense optical flow on top of a homography (Kroeger et al. 2016, DIS)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..methods import Registration
from ..warping import mapped, pixel_grid, places_of_homography, registration_at
from .features import as_uint8, keypoint_homography


@dataclass(frozen=True)
class FlowRegistrar:
    """ORB homography, then DIS flow from the live frame to the warped reference."""

    name: str = 'orb+dis'

    def register(
        self, reference: np.ndarray, live: np.ndarray, focal_px: float | None
    ) -> Registration:
        """Register a frame; see `Registrar`."""
        h = keypoint_homography(reference, live, 'orb')
        warped = registration_at(places_of_homography(h, live.shape), reference).registered
        dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        flow = dis.calc(as_uint8(live), as_uint8(warped), None)
        return registration_at(composed(h, flow), reference)


def composed(h: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Places (M, N, 2) [px]: first the flow (M, N, 2) of each live pixel, then a homography."""
    x, y = pixel_grid(flow.shape[:2])
    return mapped(h, x + flow[..., 0], y + flow[..., 1])
