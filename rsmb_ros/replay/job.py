"""One replay: what is read, what it is compared with, what is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from rsmb_ros.bags.opening import open_recording
from rsmb_ros.bags.recording import Recording, Topic
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError, ConfigError

from .detection import Compared, detected, detected_by
from .geojson_sink import GeoOptions
from .notes import image_notes, input_notes, noted
from .outlets import Sources, open_sinks, sources
from .pairs import Pairs, pairs
from .references import choose
from .selection import Picker, Selection
from .sinks import Sink
from .stored import spliced
from .summary import Summary
from .targets import check_targets, paths_named
from .unfinished import depends_on_earlier, refuse_unfinished
from .workers import WorkerPool
from .writing import writing

MOST_WORKERS = 256

T = TypeVar('T')


class Watch(Protocol):
    """Iterates over the items it is given; shows how far it is, or stops between two of them."""

    def __call__(self, items: Iterable[T], total: int, what: str) -> Iterator[T]:
        """Iterate over `items`, of which there are about `total`."""


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
        If an output is an input or another output, what is asked for does not go together, or
        an earlier replay was not finished.
    FileProblem
        If an output cannot be written.

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
    # Of each process, in place of worker.threads; not written down. 1: no thread for writing either
    threads: int | None = None
    csv: Path | None = None
    jsonl: Path | None = None
    geojson: GeoOptions | None = None
    report: Path | None = None  # HTML page
    compress: str | None = None  # 'png' or 'jpeg': photos of the output, see `recorded`
    keep_input: bool = False  # copy into the output what the results were made from
    resume: bool = False  # go on with what an earlier replay has left of the output

    def __post_init__(self) -> None:
        inputs = {'the bag': self.source}
        for path in paths_named(self.reference or ''):
            inputs['the reference'] = path
        check_targets(self.targets(), inputs)
        if not self.resume:
            refuse_unfinished(self.output)
        if not 1 <= self.workers <= MOST_WORKERS:
            raise ConfigError(f'--workers {self.workers} must be from 1 to {MOST_WORKERS}')
        if self.workers > 1 and self.config.stream.hold:
            raise ConfigError(
                f'--workers {self.workers}: with stream.hold = true each frame needs the one '
                'before it; use --workers 1, or --set stream.hold=false'
            )

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
            'selection': asdict(self.selection),
            'rate': self.rate,
            'compress': self.compress,
            'keep_input': self.keep_input,
            'keep_fixes': self.keep_input and self.geojson is not None,
        }
        return noted(values)

    def is_one_core(self) -> bool:
        """Return whether all the work is to be that of one core."""
        return self.threads == 1 and self.workers == 1

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
        given = sources(job, recording, live, reference, stack)
        found = _results(job, recording, live, reference, picker, given, stack)
        summary = Summary(job.source, live.name, resumed=len(given.stored or ()))
        first = next(found, None)
        if first is None:
            picker.check()
            raise BagError(f'{job.source}: no frame of {live.name} can be read')
        total = job.selection.expected(live.count, recording.span_ns())
        sinks: list[Sink] = []
        for sink in open_sinks(job, given, summary):
            stack.callback(sink.close)
            sinks.append(sink)
        with writing(sinks, beside=not job.is_one_core()) as written:
            for compared in watch(chain([first], found), total, live.name):
                if given.copier:
                    given.copier.collect(compared.frame)
                written.put(compared)
                summary.count_losses(recording)
        summary.count_losses(recording)
    return summary


def _results(
    job: ReplayJob,
    recording: Recording,
    live: Topic,
    reference: np.ndarray | Topic,
    picker: Picker,
    given: Sources,
    stack: ExitStack,
) -> Iterator[Compared]:
    both = pairs(recording, live, reference, picker, only_one=job.depth is not None)

    def detect(some: Pairs) -> Iterator[Compared]:
        if pool is None:
            return detected(some, recording, given.camera, job.at_work(), job.depth)
        return detected_by(pool, some, recording, job.config)

    pool = None
    if job.workers > 1:
        pool = stack.enter_context(WorkerPool(job.workers, given.camera, job.at_work(), job.depth))
    # where frames depend on those before, they are computed again, but not written again
    if given.stored and not depends_on_earlier(job.config):
        return spliced(given.stored, both, detect)
    return detect(both)
