"""Results as a page with pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core.types import Result
from rsmb_ros.report.html import Report
from rsmb_ros.report.overlay import describe, draw_overlay

from .summary import Summary


class ReportSink:
    """
    Collects pictures, and writes the page when it is closed.

    Parameters
    ----------
    path : Path
    summary : Summary
        Of this replay; its numbers stand on top of the page.
    total : int
        Frames to come, at most.

    """

    def __init__(self, path: Path, summary: Summary, total: int) -> None:
        self._path, self._summary = path, summary
        self._report = Report(f'Replay of {summary.source.name}', total)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Keep the pictures of a frame that will be shown."""
        if self._report.wants(frame.index):
            pictures = {
                'reference': reference,
                'live': frame.image,
                'registered': result.registered,
                'what changed': draw_overlay(frame.image, result),
            }
            title = f'frame {frame.index}'
            self._report.add(frame.index, title, describe(result), pictures)

    def close(self) -> None:
        """Write the page."""
        self._report.write(self._path, self._summary.values())
