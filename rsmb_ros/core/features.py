"""
Second opinion on the coarse start: where features of the live frame lie in the reference.

Slower than the vote of patches, but it copes with rotation, scale, parallax and other light; asked
only where the first start led nowhere.
"""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from .motion import Grid
from .start import StripMatches

MAX_WIDTH = 800  # px; both images are reduced to about this width of the live frame
RATIO = 0.8  # distance of the best match to that of the second (Lowe 2004)
SPREAD = 0.04  # of the width: how far rolling shutter and parallax may move a match from a plane
MIN_MATCHES = 16  # that agree; fewer may do so by chance


class FeatureSearch:
    """
    Matches features of live frames of one size to one reference.

    Parameters
    ----------
    reference : ndarray of shape (M', N'), float32
        Grey levels.
    grid : Grid
        Sizes and centres.

    """

    def __init__(self, reference: np.ndarray, grid: Grid) -> None:
        self._reference = reference
        self._grid = grid
        self._factor = max(1.0, grid.live_shape[1] / MAX_WIDTH)
        self._sift = cv2.SIFT_create(contrastThreshold=0.02)

    def match(self, live: np.ndarray) -> StripMatches | None:
        """Match a live image (M, N) float32 of grey levels; None where too few agree."""
        places, words = self._described(live)
        if words is None or self._words is None or min(len(words), len(self._words)) < MIN_MATCHES:
            return None
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words, self._words, k=2)
        good = [best for best, second in pairs if best.distance < RATIO * second.distance]
        if len(good) < MIN_MATCHES:
            return None
        here = places[[match.queryIdx for match in good]]
        there = self._places[[match.trainIdx for match in good]]
        limit = SPREAD * self._grid.live_shape[1]
        plane, kept = cv2.findHomography(here, there, cv2.RANSAC, limit, maxIters=2000)
        if plane is None or np.count_nonzero(kept) < MIN_MATCHES:
            return None
        inside = kept.ravel() > 0
        centre = self._grid.center
        place = here[inside] - centre[:2]
        shift = there[inside] - centre[2:] - place
        offset = np.median(shift, axis=0)
        return StripMatches(place, shift, np.ones_like(place), offset)

    @cached_property
    def _of_reference(self) -> tuple[np.ndarray, np.ndarray | None]:
        return self._described(self._reference)

    @property
    def _places(self) -> np.ndarray:
        return self._of_reference[0]

    @property
    def _words(self) -> np.ndarray | None:
        return self._of_reference[1]

    def _described(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Places (n, 2) [full-size px] and descriptors (n, 128) of an image's features."""
        size = [max(1, round(side / self._factor)) for side in image.shape[::-1]]
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        small = np.clip(np.rint(small), 0, 255).astype(np.uint8)
        points, words = self._sift.detectAndCompute(small, None)
        scale = np.array(image.shape[::-1]) / size
        at = np.array([point.pt for point in points], np.float64).reshape(-1, 2)
        return (at + 0.5) * scale - 0.5, words
