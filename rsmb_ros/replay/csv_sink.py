"""Regions as a table."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core.types import Result

from .text_file import TextFile

REGION_COLUMNS = (
    *('kind', 'x', 'y', 'width', 'height', 'area', 'relative_depth', 'score'),
    *('id', 'first_seen', 'reference_x', 'reference_y', 'shadow_like'),
)
CSV_COLUMNS = ('frame', 'stamp_ns', 'status', *REGION_COLUMNS)


class CsvSink:
    """Writes one line per region; a frame without regions has one line, without region."""

    def __init__(self, path: Path) -> None:
        self._file = TextFile(path, _lines([list(CSV_COLUMNS)]))

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the lines of one frame."""
        start = [frame.index, frame.stamp_ns, result.status]
        rows = [
            [_plain(getattr(region, name)) for name in REGION_COLUMNS] for region in result.regions
        ]
        self._file.write(_lines([start + row for row in rows or [[None] * len(REGION_COLUMNS)]]))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _plain(value: object) -> object:
    """Return a number of Python: a number of numpy is written in another way."""
    return value.item() if isinstance(value, np.generic) else value


def _lines(rows: list[list[object]]) -> str:
    text = StringIO(newline='')
    csv.writer(text).writerows(rows)
    return text.getvalue()
