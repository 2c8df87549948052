"""
One row's pose weights and change (Eq. 10), by our active set or by OSQP.

Both minimise, over w >= 0 and chi,

    |g - F w - chi|^2 / 2 + lambda_1 |w|_1 + (lambda_2 / 255) |chi|_1,

the objective of the authors' program: half the square, and 255 I instead of I for the change.
Eq. 10 as printed, without the half, is the same problem with both lambdas doubled. Minimised over
chi first it is exactly sum huber(g - F w) + lambda_1 |w|_1, where huber is r^2 / 2 up to
delta = lambda_2 / 255 and delta |r| - delta^2 / 2 beyond; then chi is r shrunk by delta.
"""

from __future__ import annotations

import numpy as np

from ._kernels.row_solver import huber_cost, solve_active_set
from .errors import ConfigError

LAMBDA_1 = 1e4  # weight of |w|_1, for grey levels 0..255
LAMBDA_2 = 1e3  # weight of |chi / 255|_1
WHITE = 255.0  # grey levels; the authors' unit of the change
TOLERANCE = 1e-8  # share of the cost that may be left to gain

# Worst relative gap to `solve_row` on 24 rows of 49 and 245 poses, up to half a row changed, by
# eps: 1e-4 7e-2, 1e-6 1e-7, 1e-9 4e-15 (0.3 s a row, 1000 to 13000 iterations). Polishing solves
# the KKT system of the constraints found active; with a loose eps those are wrong: it gives up.
# Without it 1e-9 reaches 3e-10. Infeasible the problem can never be, so that is not tested for: of
# ill-conditioned rows OSQP would believe it.
OSQP_SETTINGS = {
    'eps_abs': 1e-9,
    'eps_rel': 1e-9,
    'eps_prim_inf': 1e-30,
    'eps_dual_inf': 1e-30,
    'max_iter': 100_000,
    'polishing': True,
    'verbose': False,
}


def objective(
    warped_rows: np.ndarray,
    live_row: np.ndarray,
    weights: np.ndarray,
    lambda_1: float = LAMBDA_1,
    lambda_2: float = LAMBDA_2,
) -> float:
    """Cost of `weights` (K,) with the best chi; arguments as `solve_row` takes them."""
    residual = live_row.astype(np.float64) - warped_rows @ weights
    return float(huber_cost(residual, lambda_2 / WHITE) + lambda_1 * weights.sum())


def change_of(residual: np.ndarray, lambda_2: float = LAMBDA_2) -> np.ndarray:
    """Shrink g - F w by delta = lambda_2 / 255: the chi that belongs to it."""
    delta = lambda_2 / WHITE
    return residual - np.clip(residual, -delta, delta)


def solve_row(
    warped_rows: np.ndarray,
    live_row: np.ndarray,
    lambda_1: float = LAMBDA_1,
    lambda_2: float = LAMBDA_2,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Solve Eq. 10 by an active set with semismooth Newton steps.

    Parameters
    ----------
    warped_rows : ndarray of shape (N, K), float32
        ``F``: the row of the reference seen from each pose, grey levels.
    live_row : ndarray of shape (N,)
        ``g``: grey levels 0..255.
    lambda_1, lambda_2 : float
        Weights of the two l1 terms, see the module.
    start : ndarray of shape (K,), optional
        Weights of a similar row; saves time, does not alter the solution.

    Returns
    -------
    weights : ndarray of shape (K,), float64
        ``w``: share of the exposure spent at each pose, >= 0.
    change : ndarray of shape (N,), float64
        ``chi`` in grey levels.

    """
    columns = np.ascontiguousarray(warped_rows.T, np.float32)
    live = np.ascontiguousarray(live_row, np.float64)
    weights, residual = solve_transposed(columns, live, lambda_1, lambda_2, start)
    return weights, change_of(residual, lambda_2)


def solve_transposed(
    columns: np.ndarray,
    live_row: np.ndarray,
    lambda_1: float = LAMBDA_1,
    lambda_2: float = LAMBDA_2,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Solve as `solve_row` does, with F transposed: `columns` (K, N) float32, `live_row` float64.

    Returns weights (K,) and residual g - F w (N,), both float64.
    """
    weights = np.zeros(len(columns)) if start is None else np.array(start, np.float64)
    residual = np.empty(len(live_row))
    solve_active_set(columns, live_row, lambda_1, lambda_2 / WHITE, TOLERANCE, weights, residual)
    return weights, residual


def solve_row_osqp(
    warped_rows: np.ndarray,
    live_row: np.ndarray,
    lambda_1: float = LAMBDA_1,
    lambda_2: float = LAMBDA_2,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """
    Solve the same problem as `solve_row` as a quadratic program: a slow cross-check.

    Unknowns are w, the misfit m = g - F w - chi and the two signs of chi; intensities are divided
    by 255, which only scales the objective.
    """
    try:
        import osqp  # an extra: nothing else needs it
    except ImportError as error:
        raise ConfigError("registration.solver = 'osqp' needs OSQP: pip install osqp") from error
    from scipy import sparse

    n, count = warped_rows.shape
    design = sparse.csc_matrix(warped_rows.astype(np.float64) / WHITE)
    live = live_row.astype(np.float64) / WHITE
    one = sparse.identity(n, format='csc')
    hessian = sparse.block_diag(
        [sparse.csc_matrix((count, count)), one, sparse.csc_matrix((2 * n, 2 * n))], format='csc'
    )
    slope = np.concatenate(
        [
            np.full(count, lambda_1 / WHITE**2),
            np.zeros(n),
            np.full(2 * n, lambda_2 / WHITE**2),
        ]
    )
    signs = sparse.identity(count + 3 * n, format='csc')
    keep = np.r_[:count, count + n : count + 3 * n]  # m may have either sign
    constraints = sparse.vstack(
        [sparse.hstack([design, one, one, -one]), signs[keep]], format='csc'
    )
    low = np.concatenate([live, np.zeros(len(keep))])
    high = np.concatenate([live, np.full(len(keep), np.inf)])
    problem = osqp.OSQP()
    problem.setup(hessian, slope, constraints, low, high, **OSQP_SETTINGS)
    if start is not None:
        rest = live - design @ start
        problem.warm_start(
            x=np.concatenate([start, np.zeros(n), np.maximum([rest, -rest], 0).ravel()])
        )
    found = problem.solve(raise_error=False).x[:count]
    weights = np.maximum(np.nan_to_num(found), 0.0)
    return weights, change_of(live_row - warped_rows @ weights, lambda_2)
