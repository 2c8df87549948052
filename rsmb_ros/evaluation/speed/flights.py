"""Short flights that are timed: the same draws at every size, so that sizes can be compared."""

from __future__ import annotations

import numpy as np

from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import HOVER, FlightPlan, SyntheticFlight

from ..suites.nuisances import ALL, drawn
from ..suites.recipe import FLAT, NOMINAL_COLS
from ..suites.simulated import HOUSES

SCENES = {'planar': FLAT, 'layered': HOUSES}
# Motion of the rows, blur [px at 640 px of width] and exposure [rows] of each flight.
FLIGHTS = (('smooth', 8.0, 50.0), (HOVER, 5.0, 30.0), ('jello', 4.0, 20.0), ('walk', 11.0, 80.0))
OFFSET = 0.03  # share of the width
OBJECTS = 3
SHADOWS = 0.35  # light they take
RATE = 5.0  # frames per second [Hz]
_SEED = 20170301


def timed_flight(scene: str, number: int, shape: tuple[int, int], frames: int) -> SyntheticFlight:
    """
    Return a flight over a drawn scene, all usual nuisances drawn as in the suites.

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
    scale = shape[1] / NOMINAL_COLS
    plan = FlightPlan(
        frames=frames,
        rate=RATE,
        offset_px=OFFSET * shape[1],
        blur_px=blur * scale,
        timing=ShutterTiming(exposure),
        objects=OBJECTS,
        nuisances=drawn(ALL, np.random.default_rng([_SEED, number])),
        seed=_SEED + number,
        shadows=SHADOWS,
        motion=motion,
        style=SCENES[scene],
    )
    return SyntheticFlight(plan, shape)
