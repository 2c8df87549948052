"""
Rows of a frame that no path could be laid through: what they show cannot be judged.

Whatever large and new covers such rows leaves ground beside it that agrees with the path; where the
path has left its rows, nothing does.
"""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np

from .agreement import MIN_BLOCKS, Agreement, agreement, block_size

BLOCKS_ACROSS = 40  # blocks over the image's width; a band of rows is one of them high, ...
LEAST_SIZE = 16  # ... and so many px at least: smaller ones agree by chance
OUTERMOST = 2  # bands of which the reference shows something; in one of them
NOTHING = 0.1  # share of the blocks that agree below which an end is lost, ...
AGREES = 0.6  # ... up to the band where so many do: on right ends 0.66 and more
MOST = 0.4  # of the frame; more is no end
LITTLE = 0.2  # share of the blocks that agree below which a band may be lost, and is ...
IN_TURN = 5  # ... where so many bands are: large changes and noise leave more in most
BEYOND = 1  # bands beyond them, in which a path may be off by little
# Correlation of a band below which it is doubtful: on usual ground .94 and more in nine of ten; on
# bare ground .2 to .96 where rows are right, up to .62 where they are off by more than a fit says.
ALIKE = 0.9
LEAST_ALIKE = 1e-2


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
    rows, columns = grey.shape
    across = _across(grey)
    size = block_size(columns, across)
    lost = np.zeros(rows, bool)
    bands = [np.s_[at : at + size] for at in range(0, int(MOST * rows), size)]
    mirrored = [np.s_[rows - band.stop : rows - band.start] for band in bands]
    for inwards in (bands, mirrored):
        agreed = [
            agreement(frame.predicted[band], grey[band], frame.complete[band], across).share
            for band in inwards
        ]
        known = [share for share in agreed if share is not None]
        if min(known[:OUTERMOST], default=1.0) >= NOTHING:
            continue
        for band, share in zip(inwards, agreed, strict=True):
            if share is not None and share >= AGREES:
                break
            lost[band] = True
    return lost


def row_agreement(predicted: np.ndarray, grey: np.ndarray, known: np.ndarray) -> Agreement:
    """Return the `agreement` of a frame in blocks so small that bands of rows are told apart."""
    return agreement(predicted, grey, known, _across(grey))


def row_doubts(found: Agreement, rows: int) -> np.ndarray:
    """
    Return how many times less certain than a fit says the place of each row is (M,), 1 and more.

    A fit takes noise for texture where there is hardly any, and believes that it knows the place.
    Noise is not the same in the frame and its prediction: they correlate less for it. `found` is
    of the ground: what has changed says nothing.
    """
    if not found.bands.size:  # the frame is lower than a block
        return np.ones(rows)
    alike = np.maximum(np.nan_to_num(found.bands, nan=1.0), LEAST_ALIKE)
    bands = np.maximum(ALIKE / alike, 1.0)
    at = np.minimum(np.arange(rows) // found.size, len(bands) - 1)
    return bands[at]


def unlike_rows(found: Agreement, rows: int) -> np.ndarray:
    """
    Mark the rows (M,) bool of a frame, see `row_agreement`, in which hardly anything agrees.

    And those next to them, up to where most does and a little further: a path leaves its rows
    little by little.
    """
    asked, agreed = found.asked.sum(axis=1), found.agreed.sum(axis=1)
    known = asked >= MIN_BLOCKS
    unlike = (known & (agreed < LITTLE * asked)).astype(np.uint8)[:, None]
    in_turn = cv2.morphologyEx(unlike, cv2.MORPH_OPEN, np.ones((IN_TURN, 1), np.uint8))[:, 0] > 0
    right = known & (agreed >= AGREES * asked)
    between = np.cumsum(right)  # the same for all bands between two that are right
    lost = (~right & np.isin(between, between[in_turn])).astype(np.uint8)[:, None]
    lost = cv2.dilate(lost, np.ones((2 * BEYOND + 1, 1), np.uint8))[:, 0] > 0
    marked = np.zeros(rows, bool)
    marked[: len(lost) * found.size] = lost.repeat(found.size)
    return marked


def _across(grey: np.ndarray) -> int:
    """Return how many blocks are as wide as an image (M, N)."""
    return max(1, min(BLOCKS_ACROSS, grey.shape[1] // LEAST_SIZE))
