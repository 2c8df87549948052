"""Which exposures are tried when nothing is known, and which of them are finished."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.level_fit import LevelFit
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.normal_equations import NormalEquations
from rsmb_ros.core.path_estimator import COLD_EXPOSURES, tried
from rsmb_ros.core.path_fit import PathFit
from rsmb_ros.core.photometric import Light

SHAPE = (240, 320)
GRID = Grid(SHAPE, SHAPE, 300.0)


def fit_of(exposure, cost, found=None):
    path = still_path(GRID, 24.0, found or exposure, 400.0, bottom_up=False)
    return PathFit(path, Light.same(), 0.0, 3.0, cost, np.zeros((0, 0)), 1.0)


@pytest.mark.parametrize(
    ('costs', 'asked'),
    [
        ((9, 5, 4, 5, 9), {12, 36, 90}),  # the best has been tried on both sides
        ((9, 3, 4, 5, 9), {3, 12, 36, 90}),
        ((2, 3, 4, 5, 9), {3, 12, 36, 90}),
        ((9, 6, 5, 4, 9), {36, 90, 200}),
        ((9, 6, 5, 4, 3), {36, 90, 200}),
    ],
)
def test_an_exposure_is_tried_only_beside_the_best(executor, costs, asked):
    cost_of = dict(zip(COLD_EXPOSURES, costs, strict=True))

    def trial(exposure):
        return fit_of(exposure, cost_of[exposure], found=1.1 * exposure)

    fits = tried(executor, trial, COLD_EXPOSURES)
    assert {round(fit.path.exposure_rows / 1.1) for fit in fits} == asked
    assert len(fits) == len(asked)


def test_a_longer_exposure_is_tried_only_where_the_best_has_grown(executor):
    cost_of = dict(zip(COLD_EXPOSURES, (9, 6, 5, 4, 3), strict=True))

    def trial(exposure):
        return fit_of(exposure, cost_of[exposure], found=0.9 * exposure)

    fits = tried(executor, trial, COLD_EXPOSURES)
    assert {round(fit.path.exposure_rows / 0.9) for fit in fits} == {36, 90}


@pytest.mark.parametrize('exposures', [(3.0,), (3.0, 12.0)])
def test_of_few_all_are_tried(executor, exposures):
    fits = tried(executor, lambda exposure: fit_of(exposure, 1.0), exposures)
    assert {fit.path.exposure_rows for fit in fits} == set(exposures)


@pytest.fixture
def finished(texture_of, monkeypatch):
    """Return how many fits are finished at half size, by the outcome of the trials."""
    image = texture_of(SHAPE[0] + 20, SHAPE[1] + 20, 21)
    reference, live = image[10:-10, 10:-10], image[12:-8, 7:-13]

    def count(trials):
        costs = {exposure: (cost, found) for exposure, cost, found in trials}
        fitted = []
        run = LevelFit.run

        def recorded(self, fit, free_exposure, most=None, near=False, free_defocus=True):
            found = run(self, fit, free_exposure, most, near, free_defocus)
            if most is not None and not near:
                cost, exposure = costs.get(fit.path.exposure_rows, (9.0, fit.path.exposure_rows))
                return replace(found, cost=cost, path=fit_of(0, 0, exposure).path)
            if self._level.number == 1 and free_exposure and not near:
                fitted.append(fit.path.exposure_rows)
            return found

        monkeypatch.setattr(LevelFit, 'run', recorded)
        config = Config().replaced({'layers.enabled': False, 'registration.refine_rows': False})
        assert Detector(reference, Camera(300.0), config).detect(live).status == 'registered'
        monkeypatch.setattr(LevelFit, 'run', run)
        return sorted(fitted)

    return count


def test_both_of_two_that_come_close_and_lie_apart_are_finished(finished):
    assert finished([(12.0, 3.0, 10.0), (36.0, 2.9, 40.0)]) == [10.0, 40.0]


def test_one_that_is_clearly_best_is_finished_alone(finished):
    assert finished([(12.0, 3.0, 10.0), (36.0, 2.5, 40.0)]) == [40.0]


def test_of_two_that_lead_to_one_exposure_one_is_finished(finished):
    assert finished([(12.0, 3.0, 34.0), (36.0, 2.9, 40.0)]) == [40.0]


def test_a_fit_that_stands_makes_one_step(texture_of, monkeypatch):
    """Where the foreground has not bent the path, there is nothing to iterate."""
    image = texture_of(*SHAPE, 22)
    detector = Detector(image, Camera(300.0), Config().replaced({'layers.enabled': False}))
    frame = detector.detect(image).views
    stage = detector._stages[SHAPE][2]
    steps = []
    iterated = NormalEquations.iterated

    def counted(self, *arguments):
        found = iterated(self, *arguments)
        steps.append(found.steps)
        return found

    monkeypatch.setattr(NormalEquations, 'iterated', counted)
    foreground = np.zeros(SHAPE, bool)
    foreground[:, :30] = True
    stage._estimator.refine(stage._image(frame.grey), frame.fit, foreground)
    assert steps
    assert set(steps) == {1}
