"""Every case with everything on, and with one part off at a time; a stream with persistence."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import USUAL, FlightPlan, SyntheticFlight

from ..case import Case
from ..metrics import Score, score
from ..ours import Ours, outcome_of
from ..suites.recipe import case_of
from .switches import SWITCHES, Switch

ALL_ON = 'everything on'
PERSISTENT, ALONE = 'persistence 3 of 5', 'each frame alone'
PERSISTENCE = {'change.persistence_seen': 3, 'change.persistence_frames': 5}
STREAMS = {'a stream, 2 objects appear': 2, 'a stream, nothing changes': 0}  # new objects
SHAPE = (480, 640)  # rows, cols [px]
_SEED = 20170301


@dataclass(frozen=True)
class Measured:
    """Scores of one case by name of what was switched off, `ALL_ON` among them."""

    scores: Mapping[str, Score]


def ablated(
    case: Case,
    config: Config,
    settings: Mapping[str, object],
    switches: Iterable[Switch] = SWITCHES,
) -> Measured:
    """
    Measure one case with everything on, then with each part off.

    Parameters
    ----------
    case : Case
    config : Config
        What all share.
    settings : mapping
        What is known of the suite's camera.
    switches : iterable of Switch
        What is switched off, one after the other.

    """
    full = Ours(config, settings)
    full(case.reference, case.live, case.focal_px)  # the first one pays for what is cold
    found = {ALL_ON: _scored(full, case, ALL_ON)}
    for switch in switches:
        with switch.off():
            method = Ours(config.replaced(switch.settings), settings)
            found[switch.name] = _scored(method, case, switch.name)
    return Measured(found)


def streamed(name: str, frames: int, config: Config) -> Iterator[Measured]:
    """
    Fly one of `STREAMS` and detect its changes frame by frame, with persistence and without.

    Objects come one after the other; until one has been seen three times persistence misses it.
    """
    plan = FlightPlan(
        frames=frames,
        rate=5.0,
        offset_px=20.0,
        blur_px=8.0,
        timing=ShutterTiming(50.0),
        objects=STREAMS[name],
        nuisances=USUAL,
        seed=_SEED,
    )
    flight = SyntheticFlight(plan, SHAPE)
    detectors = {
        PERSISTENT: Detector(flight.reference, flight.camera, config.replaced(PERSISTENCE)),
        ALONE: Detector(flight.reference, flight.camera, config.for_one_frame()),
    }
    focal_px = flight.camera.focal_px
    for frame in flight.frames():
        called = f'{name}/{frame.index:03d}'
        case = case_of(called, flight.reference, frame.live, frame.truth, focal_px, {})
        scores = {}
        for kind, detector in detectors.items():
            begin = time.perf_counter()
            result = detector.detect(frame.live)
            registered, seconds = result.registered, time.perf_counter() - begin
            outcome = outcome_of(
                result, registered, frame.live, flight.reference.shape[:2], focal_px, seconds
            )
            scores[kind] = score(outcome, case, kind)
        yield Measured(scores)


def _scored(method: Ours, case: Case, name: str) -> Score:
    return score(method(case.reference, case.live, case.focal_px), case, name)
