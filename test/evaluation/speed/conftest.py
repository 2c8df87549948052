"""Made-up measurements."""

import pytest

from rsmb_ros.evaluation.speed.floor import FrameFloor, Work
from rsmb_ros.evaluation.speed.machine import Rates
from rsmb_ros.evaluation.speed.stream import StreamFrame
from rsmb_ros.evaluation.speed.timing import COLD, FrameTimes, Times


@pytest.fixture
def times():
    """Return a maker of times of ours: registration and change [ms]."""

    def make(registration=40.0, change=60.0, registered=True, exposure=50.0):
        steps = {'coarse': 10.0, 'registration': registration - 10.0, 'layers': change}
        return Times(registered, registration, registration + change + 2.0, steps, exposure)

    return make


@pytest.fixture
def frame_times(times):
    """Return a maker of frames; `ours` by variant, default: one cold variant."""

    def make(ecc=200.0, ours=None, shape=(480, 640), scene='planar', ecc_registered=True):
        floor = FrameFloor(1000, 8.0, 48.0, Work(2e8, 1e6), Work(1e8, 2e6))
        ours = {COLD: times()} if ours is None else ours
        return FrameTimes(shape, scene, ecc, ecc_registered, ours, 5.0, 30.0, floor)

    return make


@pytest.fixture
def rates():
    """Return a machine of 100 GFLOP/s and 10 GB/s."""
    return Rates(1e11, 1e10)


@pytest.fixture
def stream_frame(times):
    """Return a maker of frames of a stream whose true exposure is 50 rows."""

    def make(index, stream=20.0, alone=None, exposure=50.0, registered=True):
        inside = times(stream, exposure=exposure, registered=registered)
        cold = None if alone is None else times(alone)
        return StreamFrame(index, 50.0, inside, 0.05, cold, 0.04)

    return make
