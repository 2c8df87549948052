"""The report's own segmentation: an entropy threshold on the residual, outlines closed."""

from __future__ import annotations

import cv2
import numpy as np

from .config import ChangeConfig
from .segmentation import filled, without_pieces, without_small

LEVELS = 256  # of |chi|, one grey level each
BASE_PIXELS = 384 * 256  # sizes of the report are px at this frame size
CLOSE_PX = 6.0  # an outline reaches so far
SPECK_SHARE = 1e-4  # of the frame, 10 px at 384x256: fewer connected pixels are noise


def entropy_threshold(counts: np.ndarray) -> int:
    """
    Return the level that splits a histogram into the two parts of most entropy.

    Parameters
    ----------
    counts : ndarray of shape (L,), int
        How often each level occurs.

    Returns
    -------
    int
        t of most H(0..t) + H(t+1..L-1), the lowest if several; 0 where all have one level
        (Kapur, Sahoo, Wong 1985).

    """
    share = counts / max(1, counts.sum())
    logs = np.where(share > 0, share * np.log(np.where(share > 0, share, 1.0)), 0.0)
    below, entropy = np.cumsum(share), -np.cumsum(logs)
    above = 1.0 - below
    both = (below > 1e-12) & (above > 1e-12)
    if not both.any():
        return 0
    # H of a part with mass P: ln P + (sum of -p ln p) / P
    with np.errstate(divide='ignore', invalid='ignore'):
        total = np.log(below) + entropy / below + np.log(above) + (entropy[-1] - entropy) / above
    return int(np.argmax(np.where(both, total, -np.inf)))


def entropy_candidates(
    residual: np.ndarray, judged: np.ndarray, config: ChangeConfig
) -> np.ndarray:
    """
    Mark possible objects in a residual chi (M, N) [grey levels], (M, N) uint8 0/1.

    What exceeds the entropy threshold of |chi|, without specks, is an outline; outlines less than
    2 `CLOSE_PX` apart are joined by distance transform and filled.
    """
    levels = np.minimum(np.abs(residual), LEVELS - 1).astype(np.uint8)
    limit = entropy_threshold(np.bincount(levels[judged], minlength=LEVELS))
    specks = SPECK_SHARE * residual.size
    marked = without_pieces(((levels > limit) & judged).astype(np.uint8), specks)
    reach = CLOSE_PX * np.sqrt(residual.size / BASE_PIXELS)
    pad = int(np.ceil(reach)) + 1  # nothing is closed against the frame's border
    wide = np.pad(marked, pad)
    near = (_distance(wide == 0) < reach) if marked.any() else wide > 0
    whole = filled(near.astype(np.uint8))
    shrunk = (_distance(whole > 0) > reach)[pad:-pad, pad:-pad]
    return without_small((shrunk | (marked > 0)).astype(np.uint8), config)


def _distance(mask: np.ndarray) -> np.ndarray:
    """Distance of each pixel of a mask (M, N) bool to the nearest one outside it [px]."""
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
