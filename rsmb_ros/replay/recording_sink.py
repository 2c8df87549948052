"""Results as the topics that the node would have published."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.bags.writing import BagWriter, Kept
from rsmb_ros.core.config import Config
from rsmb_ros.core.types import Result

from .copying import Copier
from .recorded import recorded
from .stored import StoredFrames


class RecordingSink:
    """
    Writes every output below /rsmb/ into one .mcap; each frame is one chunk.

    Parameters
    ----------
    path : Path
    config : Config
        Written into the file.
    notes : mapping of str to str
        Also written into it.
    compress : 'png' or 'jpeg', optional
        See `recorded`.
    copier : Copier, optional
        Has collected the inputs that belong to each frame before it is given.
    stored : StoredFrames, optional
        Go on with these; the frames given first are those, and are not written again.

    """

    def __init__(
        self,
        path: Path,
        config: Config,
        notes: Mapping[str, str],
        compress: str | None = None,
        copier: Copier | None = None,
        stored: StoredFrames | None = None,
    ) -> None:
        kept = None if stored is None else Kept(stored.scan, stored.chunks)
        self._writer = BagWriter(path, config, notes, chunk_bytes=None, kept=kept)
        self._outputs = recorded(compress)
        self._copier = copier
        self._written = 0 if stored is None else len(stored)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the outputs of one frame, at its stamp, or beside its inputs."""
        is_new = self._written == 0
        if self._copier:
            self._copier.write(self._writer if is_new else None)
        if not is_new:
            self._written -= 1
            return
        # beside its inputs at their time: stamps may be of another clock
        time_ns = frame.log_time_ns if self._copier else frame.time_ns
        for output in self._outputs:
            self._writer.write(output.topic, output.build(frame, result), time_ns)
        self._writer.flush()

    def close(self) -> None:
        """Finish the file and give it its name."""
        self._writer.close()
