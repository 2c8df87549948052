"""Short flights that are timed: the same draws at every size, so that sizes can be compared."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from rsmb_ros.core import Camera
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    HOVER,
    FlightPlan,
    aerial_scene,
    live_frame,
    placed_objects,
    reference_image,
    with_shadows,
)
from rsmb_ros.core.synthesis.exposure import Path
from rsmb_ros.core.synthesis.flight import LINE_DELAY
from rsmb_ros.core.synthesis.paths import POSE_ZERO, SIX_DOF, Hover, blurred_by, offset, wobble

from ..suites.nuisances import ALL, drawn
from ..suites.recipe import FLAT, NOMINAL_COLS
from ..suites.simulated import HOUSES

SCENES = {'planar': FLAT, 'layered': HOUSES}
# Motion of the rows, blur [px at 640 px of width] and exposure [rows] of each flight.
FLIGHTS = (('smooth', 8.0, 50.0), (HOVER, 5.0, 30.0), ('jello', 4.0, 20.0), ('walk', 11.0, 80.0))
BASE_PIXELS = 640 * 480  # of a frame, up to which all flights are flown
MOST_PIXELS = 1 << 20  # of a frame that is not large
OFFSET = 0.03  # share of the width
OBJECTS = 3
SHADOWS = 0.35  # light they take
RATE = 5.0  # frames per second [Hz]
LEAST_INSTANTS = 12  # of a row's exposure
_SEED = 20170301


@dataclass(frozen=True)
class TimedFlight:
    """A reference and live frames over it, in memory: nothing is drawn while anything is timed."""

    plan: FlightPlan
    scene: str  # one of `SCENES`
    camera: Camera
    reference: np.ndarray  # (M, N, 3) uint8
    live: tuple[np.ndarray, ...]  # (M, N, 3) uint8 each, one after the other at `RATE`

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of reference and frames [px]."""
        return self.reference.shape[0], self.reference.shape[1]


def flights_at(shape: tuple[int, int], most: int) -> int:
    """Return how many flights a size gets, at least 1: large frames take long to draw."""
    return min(most, math.ceil(most * BASE_PIXELS / (shape[0] * shape[1])))


def frames_at(shape: tuple[int, int], most: int) -> int:
    """Return how many frames a flight has at a size, at least 1."""
    return max(1, most - 1) if is_large(shape) else most


def is_large(shape: tuple[int, int]) -> bool:
    """Whether frames take so long that only what the table over sizes needs is measured."""
    return shape[0] * shape[1] > MOST_PIXELS


def flight_plan(scene: str, number: int, shape: tuple[int, int], frames: int) -> FlightPlan:
    """
    Return the plan of a flight over a drawn scene, all usual nuisances drawn as in the suites.

    Parameters
    ----------
    scene : str
        One of `SCENES`.
    number : int
        Which one; motions take turns, lengths grow with the frame.
    shape : tuple of int
        Rows and columns of reference and frames [px].
    frames : int
        Live frames.

    """
    motion, blur, exposure = FLIGHTS[number % len(FLIGHTS)]
    return FlightPlan(
        frames=frames,
        rate=RATE,
        offset_px=OFFSET * shape[1],
        blur_px=blur * shape[1] / NOMINAL_COLS,
        timing=ShutterTiming(exposure),
        objects=OBJECTS,
        nuisances=drawn(ALL, np.random.default_rng([_SEED, number])),
        seed=_SEED + number,
        shadows=SHADOWS,
        motion=motion,
        style=SCENES[scene],
    )


def timed_flight(scene: str, number: int, shape: tuple[int, int], frames: int) -> TimedFlight:
    """
    Draw a flight; for the parameters see `flight_plan`.

    Other than in a `SyntheticFlight` all objects are there from the first frame on, and there is
    one instant per pixel of blur: half the work, and no step that a frame would show.
    """
    plan = flight_plan(scene, number, shape, frames)
    rng = np.random.default_rng(plan.seed)
    margin = math.ceil(plan.offset_px + 10 * plan.blur_px + 40)
    ground = aerial_scene(shape, rng, margin, plan.style)
    objects = with_shadows(placed_objects(ground, plan.objects, rng), plan.shadows)
    reference = reference_image(ground, plan.nuisances, rng)
    camera = Camera.guess(shape[1])
    grid = Grid(shape, shape, camera.focal_px)
    shake = plan.blur_px if plan.motion == HOVER else 0.0
    phase = rng.uniform(0, 2 * np.pi)
    hover = Hover(plan.offset_px, shake, plan.timing.exposure_rows, LINE_DELAY, phase)
    instants = max(LEAST_INSTANTS, math.ceil(plan.blur_px))
    live = []
    for n in range(frames):
        path = _path(plan, partial(hover.poses, (n + 1) / plan.rate), shape[0], rng)
        image, _ = live_frame(
            ground, objects, grid, path, plan.timing, plan.nuisances, rng, instants=instants
        )
        live.append(image)
    return TimedFlight(plan, scene, camera, reference, tuple(live))


def _path(plan: FlightPlan, hover: Path, rows: int, rng: np.random.Generator) -> Path:
    """Add the motion of the rows to the drone's own."""
    if plan.motion == HOVER:
        return hover
    part = wobble(plan.motion, SIX_DOF, plan.timing, rows, rng)
    return offset(POSE_ZERO, hover, blurred_by(part, plan.blur_px, plan.timing, rows))
