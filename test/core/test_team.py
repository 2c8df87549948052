"""Threads that work off pieces together: each piece once, and nobody left waiting."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba import njit

from rsmb_ros.core import Config
from rsmb_ros.core import normal_equations as equations
from rsmb_ros.core._kernels import team
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.path_estimator import PathEstimator
from rsmb_ros.core.points import LiveImage
from rsmb_ros.core.reference import Reference
from rsmb_ros.core.start import StripMatches
from rsmb_ros.core.workers import Workers

SHAPE = (240, 320)
DEADLINE_S = 60.0
PIECES, ROUNDS = 5, 400


@njit(nogil=True)
def worked_off(leads, desk, rounds, done, found):
    """Count in done (rounds, PIECES) who does what; found[0] is the round that is set out."""
    while True:
        if leads:
            if found[0] == rounds - 1:
                team.close(desk)
                return
            found[0] += 1
            team.set_out(desk)
        elif not team.wait_for_any(desk, PIECES):
            return
        while True:
            piece = team.taken(desk)
            if piece >= PIECES:
                break
            done[found[0], piece] += 1
            team.hand_in(desk)
        if leads:
            team.wait_for_all(desk, PIECES)
            found[1] += done[found[0]].sum()  # all of them, not later


@pytest.mark.oracle
@pytest.mark.parametrize('helpers', [0, 1, 3])
def test_each_piece_is_done_once_and_in_its_turn(helpers):
    desk, found = team.new_desk(), np.array([-1, 0])
    done = np.zeros((ROUNDS, PIECES), np.int64)
    with ThreadPoolExecutor(max(1, helpers)) as pool:
        others = [pool.submit(worked_off, False, desk, ROUNDS, done, found) for _ in range(helpers)]
        worked_off(True, desk, ROUNDS, done, found)
        for other in others:
            other.result(DEADLINE_S)
    assert (done == 1).all()
    assert found[1] == done.size


@pytest.mark.oracle
def test_who_comes_too_late_touches_nothing():
    desk = team.new_desk()
    desk[team.NEXT] = team.CLOSED
    worked_off(False, desk, ROUNDS, np.zeros((0, 0), np.int64), np.zeros(0, np.int64))


def fitted(texture_of, executor, exposure=None):
    """Fit a small frame by so many threads; where no `exposure` is given, some are tried."""
    image = texture_of(SHAPE[0] + 20, SHAPE[1] + 20, 31)
    reference = Reference(image[10:-10, 10:-10], 2.2)
    estimator = PathEstimator(reference, Grid(SHAPE, SHAPE, 300.0), Config(), executor)
    live = LiveImage(image[12:-8, 7:-13].astype(np.float32), 2.2)
    nothing = np.zeros((0, 2))
    return estimator.estimate(live, StripMatches(nothing, nothing, nothing, np.zeros(2)), exposure)


def test_any_number_of_threads_finds_the_same(texture_of):
    fits = []
    for threads in (1, 2, 5):
        with Workers(threads) as executor:
            fits.append(fitted(texture_of, executor))
    for fit in fits[1:]:
        assert np.array_equal(fit.path.control, fits[0].path.control)
        assert np.array_equal(fit.information, fits[0].information)
        assert (fit.cost, fit.sigma, fit.defocus) == (fits[0].cost, fits[0].sigma, fits[0].defocus)


def test_nobody_waits_for_a_leader_that_fails(texture_of, monkeypatch):
    iterate, desks = equations.iterate, []

    def failing(leads, desk, *data):
        if leads:
            desks.append(desk)
            raise KeyboardInterrupt
        return iterate(leads, desk, *data)

    monkeypatch.setattr(equations, 'iterate', failing)
    with Workers(3) as executor:
        with pytest.raises(KeyboardInterrupt):
            fitted(texture_of, executor, exposure=10.0)
        (desk,) = desks
        sent_home = desk[team.NEXT] >= team.CLOSED
        desk[team.NEXT] = team.CLOSED  # else this test would not end where it fails
    assert sent_home
