"""Results as a page with pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.reading import BagFrame
from rsmb_ros.core import Camera, Config
from rsmb_ros.core.types import Result
from rsmb_ros.report.flight.report import FlightReport

from .summary import Summary


class ReportSink:
    """
    Collects pictures, and writes the page when it is closed.

    Parameters
    ----------
    path : Path
    summary : Summary
        Of this replay; names the recording.
    config : Config
        Of this replay.
    camera : Camera, optional
        What the recording says about it.

    """

    def __init__(self, path: Path, summary: Summary, config: Config, camera: Camera | None) -> None:
        self._path, self._summary = path, summary
        self._report = FlightReport(f'Replay of {summary.source.name}', config, camera)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Keep what the page will need of a frame."""
        time_ns = frame.stamp_ns or frame.log_time_ns
        self._report.add(frame.index, time_ns, frame.image, reference, result)

    def close(self) -> None:
        """Write the page."""
        facts = {'recording': str(self._summary.source), 'topic': self._summary.topic}
        if self._summary.skipped:
            facts['frames that could not be read'] = f'{self._summary.skipped:,}'
        self._report.write(self._path, facts)
