"""A long flight over one scene: what a detector that has seen the last frames gains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core import Config, Detector, Result
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import USUAL, FlightPlan, SyntheticFlight, Truth

from ..metrics import NAN
from .timing import COLD, WARM, Times, time_ours, variants

SHAPE = (480, 640)  # rows, cols
LEARNING = 10  # frames that an estimate of the exposure may take
COLD_EVERY = 5  # frames; each of those is also registered as if it were the first


@dataclass(frozen=True)
class StreamFrame:
    """One frame of the stream."""

    index: int
    exposure_rows: float  # the true one [rows]
    stream: Times
    row_error: float  # place of the rows' centres, RMSE [px]; NaN: not registered
    alone: Times | None  # as if it were the first frame; None: not tried
    row_error_alone: float  # [px]

    @property
    def exposure_error(self) -> float:
        """Relative; NaN: not registered."""
        return abs(self.stream.exposure_rows / self.exposure_rows - 1.0)


def stream_plan(frames: int) -> FlightPlan:
    """Return the plan of ``rsmb synth --frames N``."""
    return FlightPlan(
        frames=frames,
        rate=5.0,
        offset_px=20.0,
        blur_px=8.0,
        timing=ShutterTiming(50.0),
        objects=2,
        nuisances=USUAL,
        seed=1,
    )


def stream_frames(
    frames: int, config: Config, shape: tuple[int, int] = SHAPE
) -> Iterator[StreamFrame]:
    """
    Fly and register frame by frame; only one is in memory.

    Parameters
    ----------
    frames : int
    config : Config
        What the detectors share; they do not know the exposure.
    shape : tuple of int
        Rows and columns [px].

    """
    flight = SyntheticFlight(stream_plan(frames), shape)
    configs = variants(config, flight.plan.timing.exposure_rows)
    cold = Detector(flight.reference, flight.camera, configs[COLD])
    stream = Detector(flight.reference, flight.camera, configs.get(WARM, configs[COLD]))
    for frame in flight.frames():
        if frame.index == 0:
            cold.detect(frame.live)  # preparing the reference is no part of a frame
        alone: tuple[Times | None, float] = (None, NAN)
        tried = frame.index % COLD_EVERY == 0
        first = tried and frame.index % (2 * COLD_EVERY) == 0  # in turns
        if first:
            alone = _measured(cold, frame.live, frame.truth)
        inside = _measured(stream, frame.live, frame.truth)
        if tried and not first:
            alone = _measured(cold, frame.live, frame.truth)
        yield StreamFrame(frame.index, frame.truth.exposure_rows, *inside, *alone)


def _measured(detector: Detector, live: np.ndarray, truth: Truth) -> tuple[Times, float]:
    times, result = time_ours(detector, live)
    return times, _row_error(result, truth)


def _row_error(result: Result, truth: Truth) -> float:
    """Return the RMSE of t_x and t_y of the rows [px]."""
    apart = result.row_motion[:, :2] - truth.centroids[:, :2]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
