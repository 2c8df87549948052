"""One replay: what is read, what it is compared with, what is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from rsmb_ros.bags.reading import Bag
from rsmb_ros.core import Camera, Config
from rsmb_ros.core.errors import BagError, ConfigError

from .bag_sink import BagSink
from .csv_sink import CsvSink
from .references import choose
from .report_sink import ReportSink
from .results import results
from .sinks import Sink
from .summary import Summary

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
        If the output is the input.

    """

    source: Path  # rosbag2 folder, .mcap, .db3 or ROS 1 .bag
    output: Path  # .mcap
    reference: str | None = None  # image file or topic; None: the topic named as one
    topic: str | None = None  # live images; None: the only topic it may be
    config: Config = Config()
    depth: np.ndarray | None = None  # relative depth of the only reference, see `Detector`
    csv: Path | None = None
    report: Path | None = None  # HTML page

    def __post_init__(self) -> None:
        if self.source.exists() and self.output.resolve() == self.source.resolve():
            raise ConfigError(f'-o {self.output} is the bag to be read; choose another name')


def replay(job: ReplayJob, watch: Watch = unwatched) -> Summary:
    """
    Run every frame of a recording through the detector, and write what comes out.

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
        bag = stack.enter_context(Bag(job.source))
        live, reference = choose(bag, job.reference, job.topic)
        found = results(bag, live, reference, job.config, job.depth)
        summary = Summary(job.source, live.name)
        first = next(found, None)
        if first is None:
            raise BagError(f'{job.source}: no frame of {live.name} can be read')
        sinks: list[Sink] = []
        for sink in _sinks(job, summary, bag):
            stack.callback(sink.close)
            sinks.append(sink)
        for frame, image, result in watch(chain([first], found), live.count, live.name):
            for sink in sinks:
                sink.take(frame, image, result)
            summary.skipped = bag.skipped[live.name]
        summary.skipped = bag.skipped[live.name]
    return summary


def _sinks(job: ReplayJob, summary: Summary, bag: Bag) -> Iterator[Sink]:
    """Open what the job wants written, one after the other."""
    yield BagSink(job.output, job.config)
    if job.csv:
        yield CsvSink(job.csv)
    yield summary
    if job.report:
        focal_px = bag.focal_px()
        camera = None if focal_px is None else Camera(focal_px)
        yield ReportSink(job.report, summary, job.config, camera)
