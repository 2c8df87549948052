"""Results as the topics that the node would have published."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.reading import BagFrame
from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.core.config import Config
from rsmb_ros.core.types import Result
from rsmb_ros.messages.outputs import OUTPUTS


class BagSink:
    """
    Writes every output below /rsmb/ into one .mcap.

    Parameters
    ----------
    path : Path
    config : Config
        Written into the file.

    """

    def __init__(self, path: Path, config: Config) -> None:
        self._writer = BagWriter(path, config)
        self._factory = BagFactory()

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the outputs of one frame, at its stamp."""
        for output in OUTPUTS:
            message = output.build(result, frame.image, self._factory, frame.header)
            stamp_ns = frame.stamp_ns or frame.log_time_ns
            self._writer.write(f'/rsmb/{output.name}', message, stamp_ns)

    def close(self) -> None:
        """Finish the file and give it its name."""
        self._writer.__exit__(None, None, None)
