"""Pairs of frame and reference to results, in this process or in several."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from typing import NamedTuple

import numpy as np

from rsmb_ros.bags.recording import BagFrame, Recording
from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.errors import FrameError
from rsmb_ros.core.outcome import Outcome, remembered
from rsmb_ros.core.persistence import RegionMemory
from rsmb_ros.core.settled import settled
from rsmb_ros.core.types import Result

from .pairs import Reference
from .workers import WorkerPool

AHEAD = 2  # frames in work or waiting, for each worker

_log = logging.getLogger(__name__)


class Compared(NamedTuple):
    """One frame, done."""

    frame: BagFrame
    reference: np.ndarray  # what it was compared with
    result: Result


def detected(
    pairs: Iterator[tuple[BagFrame, Reference]],
    recording: Recording,
    camera: Camera | None,
    config: Config,
    depth: np.ndarray | None,
) -> Iterator[Compared]:
    """
    Iterate over results, one after the other.

    A frame that is none for the detector is counted in `recording.skipped`.
    """
    detector, number = None, -1
    for frame, reference in pairs:
        if detector is None or number != reference.number:
            detector = Detector(reference.image, camera, config, depth)
            number = reference.number
        try:
            result = detector.detect(frame.image, frame.stamp_ns or None)
        except FrameError as error:
            _skip(recording, frame, error)
            continue
        yield Compared(frame, reference.image, settled(result))


def detected_by(
    pool: WorkerPool,
    pairs: Iterator[tuple[BagFrame, Reference]],
    recording: Recording,
    config: Config,
) -> Iterator[Compared]:
    """
    Iterate over the same results, in the same order, as several processes find them.

    At most `AHEAD` frames a worker are held.
    """
    waiting: deque[tuple[BagFrame, Reference, Future[Outcome]]] = deque()
    memory, number = RegionMemory(config.change), -1
    more = True
    while more or waiting:
        while more and len(waiting) < AHEAD * pool.count:
            pair = next(pairs, None)
            if pair is None:
                more = False
            else:
                waiting.append((*pair, pool.submit(pair[1], pair[0].image)))
        if not waiting:
            break
        frame, reference, future = waiting.popleft()
        if number != reference.number:
            memory, number = RegionMemory(config.change), reference.number
        try:
            outcome = future.result()
        except FrameError as error:
            _skip(recording, frame, error)
            continue
        result = remembered(outcome, memory, frame.stamp_ns or None)
        yield Compared(frame, reference.image, settled(result))


def _skip(recording: Recording, frame: BagFrame, error: FrameError) -> None:
    recording.skipped[frame.topic] += 1
    where = f'{recording.path}: frame {frame.index} of {frame.topic}'
    _log.warning('%s skipped: %s', where, error)
