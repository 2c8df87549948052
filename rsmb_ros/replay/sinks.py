"""What a replay gives its results to."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core.types import Result


class Sink(Protocol):
    """Takes the frames of one replay in their order, then is closed once, however it ended."""

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """
        Take one frame.

        Parameters
        ----------
        frame : BagFrame
        reference : ndarray of shape (M, N) or (M, N, 3), uint8
            What the frame was compared with.
        result : Result

        """

    def close(self) -> None:
        """Finish what is written; an interrupted replay leaves whole files, only shorter."""
