"""One replay: what is read, what it is compared with, what is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from rsmb_ros.bags.reading import Bag, Topic
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError

from .geojson_sink import GeoOptions
from .notes import image_notes, input_notes, noted
from .opening import open_sinks, sources
from .references import choose
from .results import results, unknown
from .sinks import Sink
from .summary import Summary
from .targets import check_targets
from .unfinished import depends_on_earlier, refuse_unfinished

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
        If an output is an input or another output, or an earlier replay was not finished.
    FileProblem
        If an output cannot be written.

    """

    source: Path  # rosbag2 folder, .mcap, .db3 or ROS 1 .bag
    output: Path  # .mcap
    reference: str | None = None  # image file or topic; None: the topic named as one
    topic: str | None = None  # live images; None: the only topic it may be
    config: Config = Config()
    depth: np.ndarray | None = None  # relative depth of the only reference, see `Detector`
    csv: Path | None = None
    jsonl: Path | None = None
    geojson: GeoOptions | None = None
    report: Path | None = None  # HTML page
    compress: str | None = None  # 'png' or 'jpeg': photos of the output, see `recorded`
    keep_input: bool = False  # copy into the output what the results were made from
    resume: bool = False  # go on with what an earlier replay has left of the output

    def __post_init__(self) -> None:
        inputs = {'the bag': self.source}
        if self.reference and Path(self.reference).is_file():
            inputs['the reference'] = Path(self.reference)
        check_targets(self.targets(), inputs)
        if not self.resume:
            refuse_unfinished(self.output)

    def targets(self) -> dict[str, Path]:
        """Return what will be written, by the name of its option."""
        found = {
            '-o': self.output,
            '--csv': self.csv,
            '--jsonl': self.jsonl,
            '--geojson': self.geojson.path if self.geojson else None,
            '--report': self.report,
        }
        return {name: path for name, path in found.items() if path is not None}

    def notes(self, live: Topic, reference: np.ndarray | Topic) -> dict[str, str]:
        """Return what decides the content of the output, for its metadata."""
        values = {
            'input': input_notes(self.source),
            'topic': live.name,
            'reference': image_notes(reference),
            'depth': image_notes(self.depth),
            'options': {
                'compress': self.compress,
                'keep_input': self.keep_input,
                'keep_fixes': self.keep_input and self.geojson is not None,
            },
        }
        return noted(values)


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
        given = sources(job, bag, live, reference)
        if given.copier:
            stack.callback(given.copier.close)
        stored = given.stored
        # where frames depend on those before, they are computed again, but not written again
        known = stored.take if stored and not depends_on_earlier(job.config) else unknown
        found = results(bag, live, reference, job.config, job.depth, known)
        summary = Summary(job.source, live.name, resumed=len(stored) if stored else 0)
        first = next(found, None)
        if first is None:
            raise BagError(f'{job.source}: no frame of {live.name} can be read')
        sinks: list[Sink] = []
        for sink in open_sinks(job, given, summary, live.count):
            stack.callback(sink.close)
            sinks.append(sink)
        for frame, image, result in watch(chain([first], found), live.count, live.name):
            for sink in sinks:
                sink.take(frame, image, result)
            summary.skipped = bag.skipped[live.name]
        summary.skipped = bag.skipped[live.name]
    return summary
