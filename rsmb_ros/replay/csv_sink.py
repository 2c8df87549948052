"""Regions as a table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core.types import Result

REGION_COLUMNS = (
    *('kind', 'x', 'y', 'width', 'height', 'area', 'relative_depth', 'score'),
    *('id', 'first_seen', 'reference_x', 'reference_y', 'shadow_like'),
)
CSV_COLUMNS = ('frame', 'stamp_ns', 'status', *REGION_COLUMNS)


class CsvSink:
    """Writes one line per region; a frame without regions has one line, without region."""

    def __init__(self, path: Path) -> None:
        self._stream = path.open('w', newline='')
        self._table = csv.writer(self._stream)
        self._table.writerow(CSV_COLUMNS)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the lines of one frame."""
        start = [frame.index, frame.stamp_ns, result.status]
        rows = [[getattr(region, name) for name in REGION_COLUMNS] for region in result.regions]
        self._table.writerows(start + row for row in rows or [[None] * len(REGION_COLUMNS)])
        self._stream.flush()  # an interrupted replay leaves whole lines

    def close(self) -> None:
        """Close the file."""
        self._stream.close()
