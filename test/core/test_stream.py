"""What a stream remembers: its exposure, whether that is known or has changed, and its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.path_fit import PathFit
from rsmb_ros.core.photometric import Light
from rsmb_ros.core.stream import CALIBRATION, LEAST_ERROR, StreamMemory

GRID = Grid((40, 48), (44, 52), 60.0)


def fit(own, sigma=0.5, cost=2.0, offset=(0.0, 0.0)):
    """A frame that alone would have an exposure of `own` rows."""
    path = still_path(GRID, 8.0, 30.0, 60.0, bottom_up=False)
    path.control[:, :2] = offset
    return PathFit(path, Light.same(), 0.0, 2.0, cost, np.eye(7), 1.0, False, own, sigma)


def taught(*fits):
    memory = StreamMemory()
    for one in fits:
        memory.learn(one, one)
    return memory


def test_a_new_memory_knows_nothing():
    memory = StreamMemory()
    assert memory.exposure_rows is None
    assert memory.place is None
    assert memory.last is None
    assert not memory.calibrated
    assert memory.plausible(fit(30.0, cost=1e9)), 'there is nothing to compare it with'


def test_exposure_is_the_median_of_the_frames():
    assert taught(fit(30.0)).exposure_rows == 30.0
    frames = [fit(own, sigma=1.0) for own in (33.0, 29.0, 90.0, 30.0, 28.0)]
    assert taught(*frames).exposure_rows == pytest.approx(30.0)


def test_certain_frames_weigh_more():
    frames = [fit(40.0, sigma=4.0)] * 5 + [fit(30.0, sigma=0.5)] * 2
    assert taught(*frames).exposure_rows == pytest.approx(30.0, abs=1.0)
    assert taught(*[replace(one, own_exposure_sigma=0.5) for one in frames]).exposure_rows > 38.0


def test_no_frame_is_trusted_without_limit():
    """A frame that claims to know it exactly has no more than the least error."""
    frames = [fit(30.0, sigma=1e-9), *[fit(30.5, sigma=LEAST_ERROR * 30.5)] * 3]
    assert taught(*frames).exposure_rows == pytest.approx(30.5, abs=0.1)


@pytest.mark.parametrize('own', [float('nan'), 0.0])
def test_a_frame_that_says_nothing_of_the_exposure_teaches_none(own):
    sigma = float('inf') if np.isnan(own) else 0.0
    memory = taught(fit(30.0), fit(own, sigma))
    assert memory.exposure_rows == 30.0
    assert memory.place is not None


def test_exposure_is_held_after_enough_frames_and_not_before():
    memory = StreamMemory()
    for n in range(CALIBRATION):
        assert not memory.calibrated, n
        memory.learn(fit(30.0), fit(30.0))
    assert memory.calibrated


def test_old_frames_are_forgotten():
    owns = np.linspace(30.0, 36.0, 90)
    memory = taught(*[fit(own, sigma=2.0) for own in owns])
    assert memory.exposure_rows == pytest.approx(np.median(owns[-30:]), abs=0.1)


@pytest.mark.parametrize(
    ('own', 'sigma', 'changed'),
    [
        (60.0, 1.0, True),
        (20.0, 1.0, True),
        (32.0, 0.1, False),  # certain, but within a tenth
        (36.0, 3.0, False),  # two standard deviations
        (36.0, 1.0, True),
    ],
)
def test_a_changed_exposure_is_one_that_is_far_off_and_certain(own, sigma, changed):
    memory = taught(*[fit(30.0)] * CALIBRATION)
    other = fit(own, sigma)
    assert memory.plausible(other) != changed
    memory.learn(other, other)
    assert memory.calibrated != changed, 'what was known of the camera is void'
    assert memory.exposure_rows == pytest.approx(own if changed else 30.0, abs=0.1)


def test_before_calibration_frames_may_differ():
    memory = taught(*[fit(30.0)] * (CALIBRATION - 1))
    assert memory.plausible(fit(60.0))
    memory.learn(fit(60.0), fit(60.0))
    assert memory.exposure_rows == pytest.approx(30.0)


def test_a_fit_much_worse_than_usual_is_not_plausible():
    memory = taught(*[fit(30.0, cost=cost) for cost in (1.9, 2.0, 2.1)])
    assert memory.plausible(fit(30.0, cost=2.5))
    assert not memory.plausible(fit(30.0, cost=2.7))


def test_the_usual_cost_is_that_of_first_fits():
    """A refined fit has left out what fits badly: the next first fit has not."""
    memory = StreamMemory()
    memory.learn(fit(30.0, cost=4.0), fit(30.0, cost=1.0))
    assert memory.plausible(fit(30.0, cost=4.0))


def test_place_is_that_of_the_last_frame_until_it_is_lost():
    memory = taught(fit(30.0, offset=(3.0, -2.0)), fit(31.0, offset=(5.0, 1.0)))
    np.testing.assert_allclose(memory.place, (5.0, 1.0))
    memory.lose()
    assert memory.place is None
    assert memory.last is not None
    assert memory.exposure_rows == pytest.approx(30.5), 'the camera is the same'
    memory.learn(fit(30.0, offset=(7.0, 7.0)), fit(30.0, offset=(8.0, 7.0)))
    np.testing.assert_allclose(memory.place, (8.0, 7.0))


def test_after_a_change_of_exposure_old_costs_say_nothing():
    memory = taught(*[fit(30.0, cost=1.0)] * CALIBRATION, fit(60.0, cost=5.0))
    assert memory.plausible(fit(60.0, cost=5.0))
