"""One replay: what is read, what it is compared with, what is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from rsmb_ros.bags.opening import open_recording
from rsmb_ros.bags.recording import Recording, Topic
from rsmb_ros.core import Camera, Config
from rsmb_ros.core.errors import BagError, ConfigError

from .bag_sink import BagSink
from .csv_sink import CsvSink
from .detection import Compared, detected, detected_by
from .pairs import pairs
from .references import choose
from .report_sink import ReportSink
from .selection import Picker, Selection
from .sinks import Sink
from .summary import Summary
from .workers import WorkerPool
from .writing import Writing

MOST_WORKERS = 256

T = TypeVar('T')


class Watch(Protocol):
    """Iterates over the items it is given; shows how far it is, or stops between two of them."""

    def __call__(self, items: Iterable[T], total: int, what: str) -> Iterator[T]:
        """Iterate over `items`, of which there are `total` at most."""


def unwatched(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Iterate over `items`, and that is all."""
    return iter(items)


@dataclass(frozen=True)
class ReplayJob:
    """
    One replay.

    Raises
    ------
    ConfigError
        If the output is the input, or what is asked for does not go together.

    """

    source: Path  # bag, video file or folder of images, see `open_recording`
    output: Path  # .mcap
    reference: str | None = None  # see `choose`; None: the topic named as one
    topic: str | None = None  # live images; None: the only topic it may be
    selection: Selection = field(default_factory=Selection)  # of the live frames
    rate: float | None = None  # frames/s of a video or folder of images
    config: Config = field(default_factory=Config)
    depth: np.ndarray | None = None  # relative depth of the only reference, see `Detector`
    workers: int = 1  # processes; 1: this one. Results do not depend on it
    threads: int | None = None  # of each process, in place of worker.threads; not written down
    csv: Path | None = None
    report: Path | None = None  # HTML page

    def __post_init__(self) -> None:
        if self.source.exists() and self.output.resolve() == self.source.resolve():
            raise ConfigError(f'-o {self.output} is the bag to be read; choose another name')
        if not 1 <= self.workers <= MOST_WORKERS:
            raise ConfigError(f'--workers {self.workers} must be from 1 to {MOST_WORKERS}')
        if self.workers > 1 and self.config.stream.hold:
            raise ConfigError(
                f'--workers {self.workers}: with stream.hold = true each frame needs the one '
                'before it; use --workers 1, or --set stream.hold=false'
            )

    def at_work(self) -> Config:
        """Return the configuration of the detectors; the outputs tell `config`."""
        if self.threads is None:
            return self.config
        return self.config.replaced({'worker.threads': self.threads})


def replay(job: ReplayJob, watch: Watch = unwatched) -> Summary:
    """
    Run the frames of a recording through the detector, and write what comes out.

    Equal recordings and jobs give equal outputs, byte for byte, however many workers there are.

    Parameters
    ----------
    job : ReplayJob
    watch : Watch
        Stands between the results and the sinks; what it raises ends the replay in order.

    Raises
    ------
    RsmbError
        If the recording cannot be read or does not hold what the job asks for, or an output
        cannot be written. Nothing is written before the first result.

    """
    with ExitStack() as stack:
        recording = stack.enter_context(open_recording(job.source, job.rate))
        live, reference = choose(recording, job.reference, job.topic)
        picker = Picker(job.selection, live.name)
        focal_px = recording.focal_px()
        camera = None if focal_px is None else Camera(focal_px)
        found = _results(job, recording, live, reference, camera, picker, stack)
        summary = Summary(job.source, live.name)
        first = next(found, None)
        if first is None:
            picker.check()
            raise BagError(f'{job.source}: no frame of {live.name} can be read')
        total = job.selection.at_most(live.count)
        sinks: list[Sink] = []
        for sink in _sinks(job, summary, camera):
            stack.callback(sink.close)
            sinks.append(sink)
        with Writing(sinks) as writing:
            for compared in watch(chain([first], found), total, live.name):
                writing.put(compared)
                summary.count_losses(recording)
        summary.count_losses(recording)
    return summary


def _results(
    job: ReplayJob,
    recording: Recording,
    live: Topic,
    reference: np.ndarray | Topic,
    camera: Camera | None,
    picker: Picker,
    stack: ExitStack,
) -> Iterator[Compared]:
    both = pairs(recording, live, reference, picker, only_one=job.depth is not None)
    if job.workers == 1:
        return detected(both, recording, camera, job.at_work(), job.depth)
    pool = stack.enter_context(WorkerPool(job.workers, camera, job.at_work(), job.depth))
    return detected_by(pool, both, recording, job.config)


def _sinks(job: ReplayJob, summary: Summary, camera: Camera | None) -> Iterator[Sink]:
    """Open what the job wants written, one after the other."""
    yield BagSink(job.output, job.config)
    if job.csv:
        yield CsvSink(job.csv)
    yield summary
    if job.report:
        yield ReportSink(job.report, summary, job.config, camera)
