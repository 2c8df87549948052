"""Frames as lines of JSON."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core.types import Result
from rsmb_ros.messages.as_json import to_json

from .recorded import summary_of
from .text_file import TextFile


class JsonLinesSink:
    """Writes one line per frame: stamp, status, reason, exposure, gain and regions."""

    def __init__(self, path: Path) -> None:
        self._file = TextFile(path)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the line of one frame."""
        self._file.write(to_json(summary_of(frame, result)) + '\n')

    def close(self) -> None:
        """Close the file."""
        self._file.close()
