"""The sparse normal equations of a path against dense numpy."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core._kernels.fit_row import AHEAD, EXTRA
from rsmb_ros.core._kernels.normal import assemble, assemble_gradient, row_steps
from rsmb_ros.core._kernels.residuals import spread
from rsmb_ros.core.arrow import Arrow
from rsmb_ros.core.normal_equations import tone_table
from rsmb_ros.core.priors import BEND, SLOPE, TILT_SIGMA, Priors

pytestmark = pytest.mark.oracle
KNOTS, DOF = 10, 3
UNKNOWNS = KNOTS * DOF


def jacobian(rng):
    """Rows that each see four neighbouring knots and all extras, path first."""
    rows = np.zeros((200, UNKNOWNS + AHEAD))
    for row in rows:
        knot = rng.integers(0, KNOTS - 3)
        row[knot * DOF : (knot + 4) * DOF] = rng.normal(size=4 * DOF)
    rows[:, UNKNOWNS:-1] = rng.normal(size=(200, EXTRA))
    return rows


def arrow_of(matrix):
    """Return the arrow of a symmetric matrix of that pattern."""
    arrow = Arrow.empty(UNKNOWNS, 4 * DOF)
    for j, d in np.ndindex(arrow.band.shape):
        arrow.band[j, d] = matrix[j + d, j] if j + d < UNKNOWNS else 0.0
    arrow.border[:] = matrix[UNKNOWNS:, :UNKNOWNS].T
    arrow.corner[:] = np.tril(matrix[UNKNOWNS:, UNKNOWNS:])
    return arrow


def test_an_arrow_is_solved_as_the_dense_matrix_is():
    rng = np.random.default_rng(1)
    rows = jacobian(rng)
    matrix = rows.T @ rows + 1e-3 * np.eye(len(rows.T))
    vectors = rng.normal(size=(2, len(matrix)))
    arrow = arrow_of(matrix)
    np.testing.assert_allclose(arrow.dense(), np.tril(matrix[:-1, :-1]))
    for vector, solution in zip(vectors, arrow.solved(*vectors), strict=True):
        np.testing.assert_allclose(solution, np.linalg.solve(matrix, vector), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(arrow.dense(), np.tril(matrix[:-1, :-1]))  # still itself


def test_what_cannot_be_solved_gives_no_step():
    matrix = np.eye(UNKNOWNS + AHEAD)
    matrix[5, 5] = 0.0
    assert not arrow_of(matrix).solved(np.ones(len(matrix)))[0].any()
    matrix = np.eye(UNKNOWNS + AHEAD)
    matrix[-2, -2] = -1.0
    assert not arrow_of(matrix).solved(np.ones(len(matrix)))[0].any()


def test_beliefs_are_those_written_out_densely():
    rng = np.random.default_rng(2)
    rows = jacobian(rng)
    normal, gradient = rows.T @ rows, rng.normal(size=UNKNOWNS + AHEAD)
    for dof in (3, 6):
        knots = UNKNOWNS // dof
        control = rng.normal(size=(knots, 6))
        prior = Priors((1, 5), 20.0, dof)
        band = np.tril(normal)
        band[np.abs(np.subtract.outer(*2 * (np.arange(len(band)),))) >= 3 * dof + 1] = 0.0
        band[UNKNOWNS:] = np.tril(normal)[UNKNOWNS:]
        whole = band + np.tril(band, -1).T
        arrow = Arrow.empty(UNKNOWNS, 3 * dof + 1)
        for j, d in np.ndindex(arrow.band.shape):
            arrow.band[j, d] = whole[j + d, j] if j + d < UNKNOWNS else 0.0
        arrow.border[:], arrow.corner[:] = whole[UNKNOWNS:, :UNKNOWNS].T, band[UNKNOWNS:, UNKNOWNS:]
        found, found_gradient = prior.applied(arrow, gradient, 0.3, control, 26.0, 2.0)
        expected, expected_gradient = _dense_beliefs(whole, gradient, control, dof)
        np.testing.assert_allclose(found.dense(), np.tril(expected)[:-1, :-1], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found_gradient[:-1], expected_gradient[:-1], atol=1e-9)


def _dense_beliefs(normal, gradient, control, dof):
    """Stiffness 0.3, extras 1 and 5 fixed, exposure 26 of 20 rows, sigma 2."""
    normal, gradient = normal.copy(), gradient.copy()
    knots, path = len(control), len(control) * dof
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    curvature = np.trace(normal[:path, :path]) / path + 1e-9
    belief = np.kron(second.T @ second, np.diag(BEND[:dof]))
    belief += np.kron(first.T @ first, np.diag(SLOPE[:dof]))
    belief *= 0.3 * curvature
    ridge = np.zeros((knots, dof))
    ridge[:, 4:] = (2.0 / TILT_SIGMA) ** 2
    belief += np.diag(ridge.ravel())
    normal[:path, :path] += belief + (1e-4 * curvature + 1e-9) * np.eye(path)
    gradient[:path] -= belief @ control[:, :dof].ravel()
    for n in range(path, path + EXTRA):
        normal[n, n] += 1e-6 * normal[n, n] + 1e-6
    for n in (path + 1, path + 5):
        normal[n, :] = normal[:, n] = 0.0
        normal[n, n] = 1.0
        gradient[n] = 0.0
    return normal, gradient


def test_chunks_add_up_where_their_knots_are():
    rng = np.random.default_rng(3)
    chunks, gradients = rng.normal(size=(2, 20, 20)), rng.normal(size=(2, 20))
    for chunk in chunks:  # four knots each
        chunk[:, AHEAD + 4 * DOF :] = 0.0
    gradients[:, AHEAD + 4 * DOF :] = 0.0
    begins = np.array([1, 4])
    arrow, gradient = Arrow.empty(UNKNOWNS, 4 * DOF), np.empty(UNKNOWNS + AHEAD)
    assemble(begins, DOF, chunks, *arrow.parts)
    assemble_gradient(begins, DOF, gradients, gradient)
    expected, expected_gradient = np.zeros(2 * (UNKNOWNS + AHEAD,)), np.zeros(UNKNOWNS + AHEAD)
    for begin, chunk, one in zip(begins, chunks, gradients, strict=True):
        path = begin * DOF + np.arange(4 * DOF)
        to = np.concatenate([UNKNOWNS + np.arange(AHEAD), path])
        expected[np.ix_(to, to)] += np.triu(chunk).T  # extras lie behind the path there
        expected_gradient[to] += one
    whole = expected[UNKNOWNS:, :UNKNOWNS] + expected[:UNKNOWNS, UNKNOWNS:].T
    np.testing.assert_allclose(arrow.border, whole.T)
    np.testing.assert_allclose(arrow.corner, np.tril(expected[UNKNOWNS:, UNKNOWNS:]))
    np.testing.assert_allclose(arrow.dense()[:UNKNOWNS, :UNKNOWNS], expected[:UNKNOWNS, :UNKNOWNS])
    np.testing.assert_allclose(gradient, expected_gradient)


def test_spread_of_residuals_is_that_of_numpy():
    rng = np.random.default_rng(4)
    residuals = rng.normal(0, 5.0, (30, 40)).astype(np.float32)
    residuals[3] = 1e9
    residuals[:, :4] = 1e9
    seen = np.zeros(30, bool)
    median, cost, used = spread(residuals, 1e8, 8.0, 0.2, np.zeros(4096, np.int64), 16.0, seen)
    known = np.abs(residuals[residuals < 1e8])
    assert abs(median - np.median(known)) < 1 / 16  # a bin
    np.testing.assert_allclose(cost, np.minimum(known, 8.0).mean(), rtol=1e-6)
    assert used == known.size / residuals.size
    assert np.array_equal(np.flatnonzero(~seen), [3])
    assert spread(residuals[3:4], 1e8, 8.0, 0.2, np.zeros(9, np.int64), 1.0, seen) == (0, 0, 0)


def test_row_steps_are_those_of_the_spline(bent_path):
    rng = np.random.default_rng(5)
    times, seen = np.array([-3.0, 0.0, 7.7, 21.0, 39.0]), np.array([True, True, False, True, True])
    step, reach = rng.normal(size=len(bent_path.control) * 2 + AHEAD), np.array([1.0, 0.5])
    found = row_steps(
        step, 2, times, bent_path.first_time, bent_path.knot_rows, len(bent_path.control), reach,
        seen,
    )  # fmt: skip
    moved = bent_path.spline_basis(times[seen]) @ step[:-AHEAD].reshape(-1, 2)
    np.testing.assert_allclose(found, (moved**2 @ reach).mean(), rtol=1e-9)


@pytest.mark.parametrize('gamma', [1.0, 1.8, 2.2, 3.0])
def test_tone_table_read_linearly_is_the_tone_curve(gamma):
    light = np.linspace(0.25, 1020.0, 100_001)
    place = np.sqrt(light) * 32.0
    found = np.interp(place, np.arange(len(tone_table(gamma))), tone_table(gamma))
    np.testing.assert_allclose(found, 255.0 * (light / 255.0) ** (1 / gamma), atol=3e-3)
