"""
Rows at the ends of a frame that no path could be laid through: what they show cannot be judged.

Whatever large and new covers such rows leaves ground beside it that agrees with the path; where the
path has left its rows, nothing does.
"""

from __future__ import annotations

import numpy as np

from .agreement import agreement, block_size
from .row_refinement import Frame

BLOCKS_ACROSS = 40  # blocks over the image's width; a band of rows is one of them high, ...
LEAST_SIZE = 16  # ... and so many px at least: smaller ones agree by chance
OUTERMOST = 2  # bands of which the reference shows something; in one of them
NOTHING = 0.1  # share of the blocks that agree below which an end is lost, ...
AGREES = 0.6  # ... up to the band where so many do: on right ends 0.66 and more
MOST = 0.4  # of the frame; more is no end


def lost_rows(frame: Frame, grey: np.ndarray) -> np.ndarray:
    """
    Mark the rows (M,) bool of a frame's ends at which its path does not lie.

    Parameters
    ----------
    frame : Frame
        As fitted.
    grey : ndarray of shape (M, N), float32
        Its grey levels.

    """
    rows, columns = grey.shape
    across = max(1, min(BLOCKS_ACROSS, columns // LEAST_SIZE))
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
