"""
The row problem as it stands in the papers, slow and without tricks: oracle of the row estimator.

Nothing here calls the package. Coordinates are full-size pixels, (row, col) images.
"""

from __future__ import annotations

import naive
import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation


def pose_homography(pose, focal, depth=1.0):
    """H = K (R + T n^T / d) K^-1 for tau = (t_x, t_y, r_z, scale, r_x, r_y), t = f T scale."""
    t_x, t_y, r_z, scale, r_x, r_y = pose
    rotation = Rotation.from_rotvec([r_x, r_y, r_z], degrees=True).as_matrix()
    t = np.array([t_x / (focal * scale), t_y / (focal * scale), 1.0 / scale - 1.0])
    k = np.diag([focal, focal, 1.0])
    return k @ (rotation + np.outer(t, [0, 0, 1]) / depth) @ np.linalg.inv(k)


def warped_row(fine, row, pose, columns, center, focal, depth=1.0):
    """Row of the reference seen from a pose at some columns; NaN outside the reference."""
    h = pose_homography(pose, focal, depth)
    out = np.full(len(columns), np.nan)
    for n, x in enumerate(columns):
        u, v = naive.warped_place(h, x, row, center)
        if 0 <= 2 * u <= fine.shape[1] - 2 and 0 <= 2 * v <= fine.shape[0] - 2:
            out[n] = naive.bilinear(fine, 2 * v, 2 * u)[0]
    return out


def full_objective(warped_rows, live_row, weights, change, lambda_1, lambda_2):
    """Objective of the authors' program: chi = 255 x, half the square, both l1 terms."""
    x = change / 255.0
    misfit = live_row - warped_rows @ weights - 255.0 * x
    return 0.5 * (misfit**2).sum() + lambda_1 * weights.sum() + lambda_2 * np.abs(x).sum()


def best_change(residual, lambda_2, step=0.01):
    """Minimise over chi, pixel by pixel, by trying all values in steps."""
    out = np.zeros(len(residual))
    for n, r in enumerate(residual):
        values = np.arange(-300.0, 300.0, step)
        out[n] = values[np.argmin(0.5 * (r - values) ** 2 + lambda_2 / 255.0 * np.abs(values))]
    return out


def minimum(warped_rows, live_row, lambda_1, lambda_2):
    """Least objective over w >= 0 and chi, both signs of chi as unknowns, by L-BFGS-B."""
    n, count = warped_rows.shape
    scale = np.concatenate([np.full(count, 1.0 / 255.0), np.ones(2 * n)])

    def cost(z):
        z = z * scale
        w, p, m = z[:count], z[count : count + n], z[count + n :]
        misfit = live_row - warped_rows @ w - p + m
        delta = lambda_2 / 255.0
        value = 0.5 * misfit @ misfit + lambda_1 * w.sum() + delta * (p.sum() + m.sum())
        slope = [lambda_1 - warped_rows.T @ misfit, delta - misfit, delta + misfit]
        return value, np.concatenate(slope) * scale

    options = {'maxiter': 50_000, 'maxfun': 100_000, 'ftol': 1e-15, 'gtol': 1e-9}
    bounds = [(0.0, None)] * (count + 2 * n)
    start = np.zeros(count + 2 * n)
    return minimize(cost, start, jac=True, bounds=bounds, method='L-BFGS-B', options=options).fun
