"""One row: candidate rows, the Huber problem over them, and OSQP as a second opinion."""

from __future__ import annotations

import naive_rows
import numpy as np
import pytest

from rsmb_ros.core._kernels import rows as kernels
from rsmb_ros.core._kernels.row_solver import solve_active_set
from rsmb_ros.core.row_fit import AROUND_NEIGHBOUR
from rsmb_ros.core.row_solver import (
    LAMBDA_1,
    LAMBDA_2,
    change_of,
    objective,
    solve_row,
    solve_row_osqp,
)
from rsmb_ros.core.sampling import half_pixel

DELTA = LAMBDA_2 / 255.0
CENTER = np.array([23.5, 19.5, 25.5, 21.5])  # live 40 x 48, reference 44 x 52


def some_poses(number: int) -> np.ndarray:
    rng = np.random.default_rng(number)
    return rng.normal([0, 0, 0, 1, 0, 0], [3, 3, 2, 0.02, 1, 1], (number, 6))


def warp(fine, rows, poses, center, width, stride=1, focal=60.0):
    columns = np.empty((len(poses), len(rows) * width), np.float32)
    counts = np.empty(len(poses), np.int64)
    kernels.warp_rows(
        np.array(rows), stride, poses, fine.ravel(), *fine.shape, focal, center, columns, counts
    )
    return columns, counts


class RandomRow:
    """A row of 300 px that saw a few of the poses, with noise and a change."""

    def __init__(self, texture_of, seed: int, degrees: int, changed: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        fine = half_pixel(texture_of(60, 330, seed).astype(np.float32))
        self.poses = np.array([0, 0, 0, 1, 0, 0]) + AROUND_NEIGHBOUR.first(degrees).offsets()
        center = np.array([149.5, 20.0, 164.5, 30.0])
        columns, counts = warp(fine, [20], self.poses, center, 300, focal=300.0)
        assert np.all(counts == 300)
        self.warped_rows = columns.T
        truth = np.zeros(len(self.poses))
        truth[rng.choice(len(truth), 5, replace=False)] = rng.dirichlet(np.ones(5))
        self.truth = truth
        self.live = self.warped_rows @ truth + rng.normal(0, 1.0, 300)
        if changed:
            size = int(changed * 300)
            start = int(rng.integers(0, 300 - size + 1))
            self.live[start : start + size] = rng.uniform(10, 245, size)

    def centroid(self, weights: np.ndarray) -> np.ndarray:
        return weights @ self.poses / weights.sum()


@pytest.mark.oracle
@pytest.mark.parametrize('stride', [1, 3])
def test_columns_of_f_are_rows_of_the_warped_reference(texture_of, stride):
    fine = half_pixel(texture_of(44, 52, 3).astype(np.float32))
    poses, places = some_poses(4), np.arange(0, 48, stride)
    columns, counts = warp(fine, [2, 19], poses, CENTER, len(places), stride)
    for k, pose in enumerate(poses):
        expected = np.concatenate(
            [naive_rows.warped_row(fine, i, pose, places, CENTER, 60.0) for i in (2, 19)]
        )
        seen = ~np.isnan(expected)
        assert counts[k] == seen.sum()
        np.testing.assert_array_equal(columns[k] != kernels.UNSEEN, seen)
        np.testing.assert_allclose(columns[k][seen], expected[seen], atol=2e-3)  # float32
    assert np.any(columns == kernels.UNSEEN)


@pytest.mark.oracle
def test_pixels_that_a_pose_sees_outside_are_left_out():
    u = kernels.UNSEEN
    columns = np.array([[1, 2, 3, 4], [u, 6, 7, 8], [u, u, u, 9]], np.float32)
    live, known = np.array([5.0, 6.0, 7.0, 8.0]), np.empty(4, bool)
    kernels.drop_unseen(columns, np.array([4, 3, 1]), 2.0, live, known)
    np.testing.assert_array_equal(known, [False, True, True, True])
    np.testing.assert_array_equal(columns, [[0, 2, 3, 4], [0, 6, 7, 8], [0, 0, 0, 0]])
    np.testing.assert_array_equal(live, [0, 6, 7, 8])


@pytest.mark.oracle
def test_minimum_is_that_of_a_general_optimiser():
    rng = np.random.default_rng(8)
    # smooth rows, as warps of one image are, and a change
    warped = np.cumsum(rng.normal(0, 12, (30, 6)), axis=0) + 120
    live = warped @ np.array([0.5, 0, 0.3, 0, 0.2, 0]) + rng.normal(0, 1, 30)
    live[4:10] += 60
    warped = warped.astype(np.float32)
    weights, change = solve_row(warped, live, 500.0, LAMBDA_2)
    found = naive_rows.full_objective(warped, live, weights, change, 500.0, LAMBDA_2)
    expected = naive_rows.minimum(warped.astype(float), live, 500.0, LAMBDA_2)
    assert abs(found - expected) < 1e-6 * expected


def test_minimising_over_chi_first_leaves_the_huber_loss(texture_of):
    row = RandomRow(texture_of, 1, 2, changed=0.2)
    rng = np.random.default_rng(2)
    for weights in (row.truth, rng.uniform(0, 0.04, len(row.poses))):
        residual = row.live - row.warped_rows @ weights
        change = naive_rows.best_change(residual, LAMBDA_2)
        np.testing.assert_allclose(change_of(residual), change, atol=0.006)  # half a step
        full = naive_rows.full_objective(
            row.warped_rows, row.live, weights, change, LAMBDA_1, LAMBDA_2
        )
        # the best of values 0.01 apart: at most 300 * 0.005^2 / 2 more
        assert 0 <= full - objective(row.warped_rows, row.live, weights) < 0.004


@pytest.mark.parametrize('degrees', [2, 3])
def test_objective_is_that_of_osqp(texture_of, degrees):
    pytest.importorskip('osqp')
    for seed in range(10):
        row = RandomRow(texture_of, seed, degrees, changed=0.05 * seed)
        weights, change = solve_row(row.warped_rows, row.live)
        others, other_change = solve_row_osqp(row.warped_rows, row.live)
        ours = objective(row.warped_rows, row.live, weights)
        theirs = objective(row.warped_rows, row.live, others)
        assert abs(ours - theirs) < 1e-6 * theirs
        np.testing.assert_allclose(change, other_change, atol=0.01)  # grey levels


@pytest.mark.parametrize('degrees', [2, 3])
@pytest.mark.parametrize('changed', [0.0, 0.3, 0.6, 0.95])
def test_solution_is_optimal(texture_of, degrees, changed):
    """Karush-Kuhn-Tucker: no slope down, and none at all where there is weight."""
    for seed in range(8):
        row = RandomRow(texture_of, seed, degrees, changed)
        weights, _ = solve_row(row.warped_rows, row.live)
        psi = np.clip(row.live - row.warped_rows @ weights, -DELTA, DELTA)
        slope = LAMBDA_1 - row.warped_rows.astype(float).T @ psi
        small = 1e-7 * objective(row.warped_rows, row.live, weights)
        assert np.all(weights >= 0)
        assert slope.min() > -small
        assert np.abs(slope[weights > 0]).max() < small


def test_start_changes_the_time_but_not_the_solution(texture_of):
    for seed in range(5):
        row = RandomRow(texture_of, seed, 3, changed=0.2)
        cold, _ = solve_row(row.warped_rows, row.live)
        rng = np.random.default_rng(seed)
        warm, _ = solve_row(
            row.warped_rows, row.live, start=rng.uniform(0, 0.02, 245) * (rng.random(245) < 0.1)
        )
        np.testing.assert_allclose(
            objective(row.warped_rows, row.live, warm),
            objective(row.warped_rows, row.live, cold),
            rtol=1e-7,
        )
        np.testing.assert_allclose(row.centroid(warm), row.centroid(cold), atol=1e-3)


def test_changes_on_a_third_of_the_row_hardly_move_the_centroid(texture_of):
    for seed in range(10):
        row = RandomRow(texture_of, seed, 2, changed=0.3)
        weights, _ = solve_row(row.warped_rows, row.live)
        error = row.centroid(weights) - row.centroid(row.truth)
        assert np.abs(error[:2]).max() < 0.15  # px


def test_change_holds_what_the_poses_do_not_explain(texture_of):
    row = RandomRow(texture_of, 4, 2)
    row.live[100:140] += 80
    _, change = solve_row(row.warped_rows, row.live)
    np.testing.assert_allclose(change[100:140], 80 - DELTA, atol=6)  # noise of 1, 4 sigma + misfit
    assert np.count_nonzero(np.delete(change, np.s_[100:140])) < 6


def test_solution_does_not_depend_on_where_the_arrays_lie(texture_of):
    row = RandomRow(texture_of, 5, 3, changed=0.2)
    solutions = []
    for shift in (0, 1, 3, 5):
        columns = np.empty(row.warped_rows.size + shift, np.float32)[shift:]
        columns = columns.reshape(row.warped_rows.T.shape)
        columns[:] = row.warped_rows.T
        live = np.empty(300 + shift)[shift:]
        live[:] = row.live
        weights, residual = np.zeros(245), np.empty(300 + shift)[shift:]
        solve_active_set(columns, live, LAMBDA_1, DELTA, 1e-8, weights, residual)
        solutions.append(np.concatenate([weights, residual]))
    for other in solutions[1:]:
        np.testing.assert_array_equal(other, solutions[0])


def test_a_row_of_zeros_has_no_weights():
    weights, change = solve_row(np.full((50, 9), 100, np.float32), np.zeros(50))
    assert not weights.any()
    assert not change.any()
