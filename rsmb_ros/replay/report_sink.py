"""Results as a page with pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.recording import BagFrame
from rsmb_ros.core import Camera, Config
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.core.types import Result
from rsmb_ros.report.flight.report import FlightReport
from rsmb_ros.report.words import numbers

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

    Raises
    ------
    FileProblem
        If there is no folder for the page.

    """

    def __init__(self, path: Path, summary: Summary, config: Config, camera: Camera | None) -> None:
        if not path.parent.is_dir():  # found out now, not after hours of work
            raise FileProblem(f'{path}: cannot be written: no folder {path.parent}')
        self._path, self._summary = path, summary
        self._report = FlightReport(f'Replay of {summary.source.name}', config, camera)

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Keep what the page will need of a frame."""
        self._report.add(frame.index, frame.time_ns, frame.image, reference, result)

    def close(self) -> None:
        """Write the page."""
        facts = {'recording': str(self._summary.source), 'topic': self._summary.topic}
        self._report.write(self._path, facts, self._losses())

    def _losses(self) -> list[str]:
        """Return what of the recording could not be read."""
        summary, told = self._summary, []
        if summary.damaged:
            lost = numbers(summary.lost, 'message')
            told.append(f'The recording is damaged: at least {lost} could not be read.')
        if summary.skipped:
            told.append(f'{numbers(summary.skipped, "frame")} could not be read.')
        return told
