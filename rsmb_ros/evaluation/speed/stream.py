"""A long flight over one scene: what a detector that has seen the last frames gains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import USUAL, FlightPlan, SyntheticFlight, Truth

from ..metrics import NAN
from ..warping import mapped
from .timing import COLD, WARM, Times, time_ours, variants

SHAPE = (480, 640)  # rows, cols
LEARNING = 10  # frames that an estimate of the exposure may take
COLD_EVERY = 10  # frames; each of those is also registered as if it were the first
COLUMNS = 9  # places of a row that are compared


@dataclass(frozen=True)
class StreamFrame:
    """One frame of the stream."""

    index: int
    exposure_rows: float  # the true one [rows]
    stream: Times
    row_error: float  # place of the rows, RMSE [px]; NaN: not registered
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
    grid = Grid(shape, shape, flight.camera.focal_px)
    cold = Detector(flight.reference, flight.camera, configs[COLD])
    stream = Detector(flight.reference, flight.camera, configs.get(WARM, configs[COLD]))
    for frame in flight.frames():
        if frame.index == 0:
            cold.detect(frame.live)  # preparing the reference is no part of a frame
        alone: tuple[Times | None, float] = (None, NAN)
        tried = frame.index % COLD_EVERY == 0
        first = tried and frame.index % (2 * COLD_EVERY) == 0  # in turns
        if first:
            alone = _measured(cold, frame.live, frame.truth, grid)
        inside = _measured(stream, frame.live, frame.truth, grid)
        if tried and not first:
            alone = _measured(cold, frame.live, frame.truth, grid)
        yield StreamFrame(frame.index, frame.truth.exposure_rows, *inside, *alone)


def row_error(found: np.ndarray, true: np.ndarray, grid: Grid) -> float:
    """
    Return how far the rows lie from their true places, RMSE over rows [px].

    Parameters
    ----------
    found, true : ndarray of shape (M, 6)
        Centroid pose of each row. What one component of a pose does another can undo: it is the
        mean place of a row's pixels that is compared.
    grid : Grid

    """
    rows, cols = grid.live_shape
    x = np.linspace(-0.5, 0.5, COLUMNS) * (cols - 1)
    y = (np.arange(rows) - (rows - 1) / 2)[:, None]
    places = [
        mapped(homographies(coordinates_from_poses(poses, grid), grid)[:, None], x, y)
        for poses in (found, true)
    ]
    apart = (places[0] - places[1]).mean(axis=1)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _measured(
    detector: Detector, live: np.ndarray, truth: Truth, grid: Grid
) -> tuple[Times, float]:
    times, result = time_ours(detector, live)
    error = row_error(result.row_motion, truth.centroids, grid) if times.registered else NAN
    return times, error
