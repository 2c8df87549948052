"""What the path estimator finds out about a live frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from ._kernels.fit_row import EXTRA
from .motion import CameraPath
from .photometric import Light


@dataclass(frozen=True)
class PathFit:
    """Outcome of the estimation."""

    path: CameraPath
    light: Light
    defocus: float  # variance of the live frame's blur that is not motion, over reference's [px^2]
    sigma: float  # robust standard deviation of the residual [grey levels]
    cost: float  # mean truncated residual [grey levels]; compares starts
    information: np.ndarray  # (D, D) inverse covariance of control points and extras [1/px^2]
    used: float  # share of the points that lie in the reference, 0..1
    exposure_held: bool = False  # it was given, and not looked for in this frame
    own_exposure: float = float('nan')  # what this frame alone says of it [rows]
    own_exposure_sigma: float = float('inf')  # [rows]
    lost: np.ndarray | None = None  # (M,) bool, rows at which the path does not lie; None: none


def row_uncertainty(fit: PathFit) -> np.ndarray:
    """
    Return the standard deviation of each row's place at mid-exposure (M,) [px], from the Hessian.

    Infinite where nothing is known of it.
    """
    path = fit.path
    knots = len(path.control)
    dof = (len(fit.information) - EXTRA) // knots
    factor, failed = dpotrf(fit.information, lower=1)
    if failed:
        return np.full(len(path.row_times), np.inf)
    # x of all knots, then y: their part of (L L^T)^-1 is U^T U, L U being their unit vectors
    own = np.concatenate([np.arange(e, knots * dof, dof) for e in (0, 1)])
    units = np.zeros((len(own), len(fit.information)))
    units[np.arange(len(own)), own] = 1.0
    roots = dtrtrs(factor, units.T, lower=1)[0].T
    basis = path.spline_basis(path.row_times)
    variance = np.zeros(len(basis))
    for root in (roots[:knots], roots[knots:]):
        variance += ((basis @ (root @ root.T)) * basis).sum(axis=1)
    if fit.lost is not None:
        variance[fit.lost] = np.inf
    return np.sqrt(variance)
