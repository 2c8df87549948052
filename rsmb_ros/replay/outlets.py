"""The sinks of a job."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.recording import CAMERA_INFO, Recording, Topic
from rsmb_ros.bags.writing import provenance
from rsmb_ros.core import Camera
from rsmb_ros.core.errors import ConfigError

from .copying import Copier
from .csv_sink import CsvSink
from .geojson_sink import Flight, GeoJsonSink, fix_topic, flight_of
from .jsonl_sink import JsonLinesSink
from .recording_sink import RecordingSink
from .report_sink import ReportSink
from .sinks import Sink
from .stored import StoredFrames
from .summary import Summary
from .unfinished import unfinished

if TYPE_CHECKING:
    from .job import ReplayJob


@dataclass(frozen=True)
class Sources:
    """What detector and sinks need beside the frames; made before the work begins."""

    camera: Camera | None  # what the recording says of it
    notes: Mapping[str, str]
    stored: StoredFrames | None  # what an earlier replay has left
    flight: Flight | None
    copier: Copier | None


def sources(
    job: ReplayJob,
    recording: Recording,
    live: Topic,
    reference: np.ndarray | Topic,
    stack: ExitStack,
) -> Sources:
    """
    Read what a job will need; what is opened is closed with `stack`.

    Raises
    ------
    RsmbError
        If the recording does not hold it, or the job cannot go on with what is there.

    """
    focal_px = recording.focal_px()
    camera = None if focal_px is None else Camera(focal_px)
    flight = copier = None
    if job.geojson:
        flight = flight_of(_bag(recording, '--geojson'), job.geojson, job.config)
    if job.keep_input:
        copier = _copier(job, _bag(recording, '--keep-input'), live, reference)
        stack.callback(copier.close)
    notes = job.notes(live, reference)
    stored = unfinished(job.output, provenance(job.config) | notes) if job.resume else None
    return Sources(camera, notes, stored, flight, copier)


def open_sinks(job: ReplayJob, given: Sources, summary: Summary) -> Iterator[Sink]:
    """
    Open what the job wants written, one after the other.

    Texts come before the recording: what it holds of a frame, they hold too, whenever the process
    is killed. They are written anew by a job that goes on.
    """
    if job.geojson and given.flight:
        yield GeoJsonSink(job.geojson, given.flight)
    if job.csv:
        yield CsvSink(job.csv)
    if job.jsonl:
        yield JsonLinesSink(job.jsonl)
    yield RecordingSink(
        job.output, job.config, given.notes, job.compress, given.copier, given.stored
    )
    yield summary
    if job.report:
        yield ReportSink(job.report, summary, job.config, given.camera)


def _copier(job: ReplayJob, bag: Bag, live: Topic, reference: np.ndarray | Topic) -> Copier:
    others = [topic.name for topic in bag.topics if topic.type == CAMERA_INFO and topic.count]
    if isinstance(reference, Topic):
        others.append(reference.name)
    if job.geojson:
        others.append(fix_topic(job.geojson, bag))
    return Copier(bag, live.name, others)


def _bag(recording: Recording, option: str) -> Bag:
    if not isinstance(recording, Bag):
        raise ConfigError(f'{option} is for bags, which hold messages; {recording.path} is none')
    return recording
