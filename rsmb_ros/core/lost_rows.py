"""
Rows of a frame that no path could be laid through: what they show cannot be judged.

Whatever large and new covers such rows leaves ground beside it that agrees with the path; where the
path has left its rows, nothing does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from .agreement import agreement, block_size

BLOCKS_ACROSS = 40  # blocks over the image's width; a band of rows is one of them high, ...
LEAST_SIZE = 16  # ... and so many px at least: smaller ones agree by chance
OUTERMOST = 2  # bands of which the reference shows something; in one of them
NOTHING = 0.1  # share of the blocks that agree below which an end is lost, ...
AGREES = 0.6  # ... up to the band where so many do: on right ends 0.66 and more
MOST = 0.4  # of the frame; more is no end
LITTLE = 0.2  # share of the blocks that agree below which a band may be lost, and is ...
IN_TURN = 5  # ... where so many bands are: large changes and noise leave more in most


class Compared(Protocol):
    """What is asked of a frame."""

    predicted: np.ndarray  # (M, N) float32 [grey levels]
    complete: np.ndarray  # (M, N) bool, whether the reference shows all of it


def lost_rows(frame: Compared, grey: np.ndarray) -> np.ndarray:
    """
    Mark the rows (M,) bool of a frame's ends at which its path does not lie.

    Parameters
    ----------
    frame : Compared
        As fitted.
    grey : ndarray of shape (M, N), float32
        Its grey levels.

    """
    rows = len(grey)
    lost = np.zeros(rows, bool)
    bands = _bands(grey, int(MOST * rows))
    mirrored = [np.s_[rows - band.stop : rows - band.start] for band in bands]
    for inwards in (bands, mirrored):
        agreed = _agreed(frame, grey, inwards)
        known = [share for share in agreed if share is not None]
        if min(known[:OUTERMOST], default=1.0) >= NOTHING:
            continue
        for band, share in zip(inwards, agreed, strict=True):
            if share is not None and share >= AGREES:
                break
            lost[band] = True
    return lost


def unlike_rows(frame: Compared, grey: np.ndarray) -> np.ndarray:
    """Mark the rows (M,) bool of a frame, see `lost_rows`, in which hardly anything agrees."""
    bands = _bands(grey, len(grey))
    agreed = _agreed(frame, grey, bands)
    unlike = np.array([share is not None and share < LITTLE for share in agreed], np.uint8)
    unlike = cv2.morphologyEx(unlike[:, None], cv2.MORPH_OPEN, np.ones((IN_TURN, 1), np.uint8))
    rows = np.zeros(len(grey), bool)
    for band, lost in zip(bands, unlike[:, 0], strict=True):
        rows[band] = lost
    return rows


def _bands(grey: np.ndarray, last: int) -> list[slice]:
    """Cut rows 0 to `last` of an image (M, N) into bands as high as their blocks."""
    size = block_size(grey.shape[1], _across(grey))
    return [np.s_[at : at + size] for at in range(0, last, size)]


def _agreed(frame: Compared, grey: np.ndarray, bands: Sequence[slice]) -> list[float | None]:
    """Return the share of the blocks of each band that agree."""
    across = _across(grey)
    return [
        agreement(frame.predicted[band], grey[band], frame.complete[band], across).share
        for band in bands
    ]


def _across(grey: np.ndarray) -> int:
    return max(1, min(BLOCKS_ACROSS, grey.shape[1] // LEAST_SIZE))
