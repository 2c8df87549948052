"""Ours and ECC on the same frames, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from rsmb_ros.core import REGISTERED, Config, Detector, Result
from rsmb_ros.core.frame import RegisteredFrame
from rsmb_ros.core.photometric import luma

from ..methods import NotRegistered
from ..metrics import NAN
from ..rivals.ecc import EccRegistrar
from ..summary import median
from .flights import TimedFlight, is_large
from .floor import FrameFloor, frame_floor

HOLD = 'stream.hold'  # switch of the detector's memory, in versions that have one
TAUGHT = 10  # frames a stream is shown before it is timed: then its exposure is held
# Steps of `Result.timings_ms` that look for changes; all others are registration and rendering, so
# that a step nobody has thought of is not hidden.
CHANGE_STEPS = ('change', 'layers', 'refine', 'layers again', 'other way')
COLD, GIVEN, WARM, FLAT = 'exposure unknown', 'exposure given', 'warm stream', 'layers off'


@dataclass(frozen=True)
class Times:
    """Time of ours on one frame."""

    registered: bool
    registration_ms: float  # from the uint8 frame to its registered grey image
    total_ms: float  # of `Detector.detect`
    steps_ms: Mapping[str, float]
    exposure_rows: float  # found [rows]

    @property
    def elsewhere_ms(self) -> float:
        """Time that no step accounts for."""
        return self.total_ms - sum(self.steps_ms.values())


@dataclass(frozen=True)
class FrameTimes:
    """Everything measured on one frame."""

    shape: tuple[int, int]
    scene: str
    ecc_ms: float
    ecc_registered: bool
    ours: Mapping[str, Times]  # by variant
    colour_ms: float  # the registered image in colour, on request
    prepare_ms: float  # the reference, once
    floor: FrameFloor | None = field(repr=False)  # None: not registered


def variants(config: Config, exposure_rows: float) -> dict[str, Config]:
    """
    Return the configurations that are timed, by name.

    Parameters
    ----------
    config : Config
        What they share.
    exposure_rows : float
        The true one, for the variant to which it is given [rows].

    """
    unknown = {'shutter.exposure_rows': 0.0}
    alone = {HOLD: False} if has_memory() else {}
    found = {
        COLD: config.replaced({**unknown, **alone}),
        GIVEN: config.replaced({'shutter.exposure_rows': exposure_rows, **alone}),
        FLAT: config.replaced({**unknown, **alone, 'layers.enabled': False}),
    }
    if has_memory():
        found[WARM] = config.replaced({**unknown, HOLD: True})
    return found


def has_memory() -> bool:
    """Return whether the detector can start a frame from what the last ones taught."""
    return HOLD in Config().flat()


def times_of_flight(flight: TimedFlight, config: Config) -> Iterator[FrameTimes]:
    """
    Time every method on every frame, in turns.

    Parameters
    ----------
    flight : TimedFlight
        Its frames are shown to the stream again and again until it is warm, then timed.
    config : Config
        What all variants share.

    """
    configs = variants(config, flight.plan.timing.exposure_rows)
    if is_large(flight.shape):
        configs = {name: configs[name] for name in (COLD, FLAT)}
    detectors, prepare_ms = _prepared(configs, flight)
    grey = luma(flight.reference)
    for turn in range(len(flight.live)):
        live = flight.live[(TAUGHT + turn) % len(flight.live)]  # the stream goes on
        yield _timed(flight, grey, live, detectors, turn, prepare_ms)


def _prepared(
    configs: Mapping[str, Config], flight: TimedFlight
) -> tuple[dict[str, Detector], float]:
    """Return detectors that know the reference, and the time that took [ms]; teach the stream."""
    live, detectors, spent = flight.live[0], {}, []
    for name, config in configs.items():
        begin = perf_counter()
        detector = detectors[name] = Detector(flight.reference, flight.camera, config)
        if name == WARM:
            for n in range(TAUGHT):
                detector.detect(flight.live[n % len(flight.live)])
            continue
        detector.detect(live)
        first = perf_counter() - begin
        begin = perf_counter()
        detector.detect(live).registered  # noqa: B018 - prepares the colours, too
        spent.append(1e3 * (first - (perf_counter() - begin)))
    return detectors, median(spent)


def _timed(
    flight: TimedFlight,
    grey: np.ndarray,
    live: np.ndarray,
    detectors: Mapping[str, Detector],
    turn: int,
    prepare_ms: float,
) -> FrameTimes:
    ours: dict[str, Times] = {}
    ecc = (NAN, False)
    colour_ms, floor = NAN, None
    order = [*detectors, 'ecc']
    first = turn % len(order)  # nobody always has the caches another one has warmed
    for name in order[first:] + order[:first]:
        if name == 'ecc':
            ecc = time_ecc(grey, live)
            continue
        ours[name], result = time_ours(detectors[name], live)
        if name == COLD:
            begin = perf_counter()
            result.registered  # noqa: B018 - computed on first use
            colour_ms = 1e3 * (perf_counter() - begin)
            floor = _floor(result, detectors[name].config)
    return FrameTimes(flight.shape, flight.scene, *ecc, ours, colour_ms, prepare_ms, floor)


def time_ours(detector: Detector, live: np.ndarray) -> tuple[Times, Result]:
    """Time one frame, uint8, grey or BGR."""
    begin = perf_counter()
    luma(live)  # ECC's grey levels are timed as well; the detector's own are in no step
    grey_ms = 1e3 * (perf_counter() - begin)
    begin = perf_counter()
    result = detector.detect(live)
    total = 1e3 * (perf_counter() - begin)
    found = sum(ms for step, ms in result.timings_ms.items() if step not in CHANGE_STEPS)
    times = Times(
        registered=result.status == REGISTERED,
        registration_ms=grey_ms + found,
        total_ms=total,
        steps_ms=dict(result.timings_ms),
        exposure_rows=result.exposure_rows,
    )
    return times, result


def time_ecc(reference: np.ndarray, live: np.ndarray) -> tuple[float, bool]:
    """
    Time ECC of the suites from the uint8 frame to the warped reference.

    Parameters
    ----------
    reference : ndarray of shape (M, N), float32
        Grey levels, prepared once as ours is.
    live : ndarray of shape (M, N) or (M, N, 3), uint8

    Returns
    -------
    ms : float
    registered : bool

    """
    begin = perf_counter()
    try:
        EccRegistrar().register(reference, luma(live), None)
        registered = True
    except NotRegistered:
        registered = False
    return 1e3 * (perf_counter() - begin), registered


def _floor(result: Result, config: Config) -> FrameFloor | None:
    if isinstance(result.views, RegisteredFrame):
        return frame_floor(result.views.path, config.registration.degrees_of_freedom)
    return None
