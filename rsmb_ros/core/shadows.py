"""
Changes of light only: where a cast shadow has come or gone, the ground stays as it was.

A shadow multiplies the linear light of the ground, and so, under a tone curve v = l^(1/gamma), its
display values. What the reference shows there must then show through, texture and all; where there
is no texture nothing can tell a shadow from a dark object, and it is called an object.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from .change_finder import LOST, Finding
from .evidence import MAX_Z2, Texture
from .frame import RegisteredFrame
from .segmentation import Blob

RIM = 7  # px, window of the erosion: half-shadow and blur at the outline are left out
WINDOW = 9  # px over which light is levelled: what varies more slowly may be half-shadow
MIN_CORE = 200  # px, fewer do not tell a correlation from chance
MIN_TEXTURE = 1.5  # grey levels of detail in the prediction, above what noise and JPEG leave
LEAST_FACTOR, MOST_FACTOR = 1.04, 3.0  # of display values, darker or lighter; 3: 1/11 of the light
ALIKE = 0.7  # least correlation of the details; shadows have .78 to .99, objects up to .77
SAME_DETAIL = (0.75, 1.4)  # contrast of the details over the factor: haze and dirt change it
SAME_COLOUR = 1.15  # largest factor of a colour over the smallest: the sky's own light is blue
DARK = np.float32(4.0)  # grey levels, darker means divide by this


def shadow_like(blob: Blob, finding: Finding, most: float) -> bool:
    """
    Say whether a change may be that of a shadow, or of light that fell there before.

    Parameters
    ----------
    blob : Blob
        Where the change is.
    finding : Finding
    most : float
        Evidence that no place in it may reach once the factor is taken out [sigma]: an object
        that lies in a shadow is no shadow.

    """
    frame, box = finding.frame, blob.box
    core = cv2.erode(np.pad(blob.mask, 1).astype(np.uint8), np.ones((RIM, RIM), np.uint8))
    core = (core[1:-1, 1:-1] > 0) & frame.judged[box]
    if np.count_nonzero(core) < MIN_CORE:
        return False
    here = core.astype(np.float32)
    share = np.maximum(cv2.blur(here, (WINDOW, WINDOW)), np.float32(1e-3))

    def levelled(image: np.ndarray) -> np.ndarray:
        """Mean of an image over the window, of what is in the core."""
        return cv2.blur(image * here, (WINDOW, WINDOW)) / share

    expected, seen = frame.predicted[box], frame.grey[box]
    means = levelled(expected), levelled(seen)
    factors = means[1] / np.maximum(means[0], DARK)
    factor = float(np.median(factors[core]))
    if not LEAST_FACTOR <= max(factor, 1.0 / max(factor, 1e-3)) <= MOST_FACTOR:
        return False
    before, after = expected - means[0], seen - means[1]
    if not _alike(before[core], after[core], factor):
        return False
    left = ((after - factors * before) / _sigma(finding, box)) ** 2
    # sums that a blur keeps as it goes end a little below 0 where there is nothing
    evidence = np.sqrt(np.maximum(levelled(np.minimum(left, np.float32(MAX_Z2)))[core], 0.0))
    return float(evidence.max()) < most and _one_colour(frame, box, core)


def _alike(before: np.ndarray, after: np.ndarray, factor: float) -> bool:
    """Say whether details (n,) [grey levels] are the same but for a factor."""
    power, common = float(before @ before), float(before @ after)
    if power < MIN_TEXTURE**2 * len(before):
        return False
    correlation = common / math.sqrt(power * float(after @ after) + 1e-9)
    low, high = SAME_DETAIL
    return correlation >= ALIKE and low <= common / power / factor <= high


def _sigma(finding: Finding, box: tuple[slice, slice]) -> np.ndarray:
    """Noise expected in a box of the frame [grey levels]."""
    frame = finding.frame
    place = np.nan_to_num(frame.row_uncertainty[box[0]], posinf=LOST)
    return finding.seen.noise(Texture.of(frame.predicted[box]), place) * frame.misfit[box]


def _one_colour(frame: RegisteredFrame, box: tuple[slice, slice], core: np.ndarray) -> bool:
    """Say whether all colours have got lighter or darker alike; grey images have but one."""
    if frame.live.ndim == 2:
        return True
    expected = frame.registered()[box]
    if expected.ndim == 2:
        return True
    before, after = (image[core].sum(axis=0) for image in (expected, frame.live[box]))
    factors = after / np.maximum(before, 1.0)
    return float(factors.max()) <= SAME_COLOUR * float(factors.min())
