"""What is believed of a camera path before the data are seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ._kernels.fit_row import EXTRA

# How reluctantly each path coordinate bends and changes; a row alone hardly sees the tilt.
BEND = np.array([0.1, 0.1, 0.2, 0.4, 2.0, 2.0])
SLOPE = np.array([0.0, 0.0, 0.0, 0.05, 2.0, 8.0])
TILT_SIGMA = 4.0  # px at half width, prior on the perspective terms (1.3 deg at f = 0.9 width)
EXPOSURE_SIGMA = 0.3  # relative prior on the exposure while it is estimated


@dataclass(frozen=True)
class Priors:
    """What is believed before the data are seen."""

    stiffness: float
    fixed: tuple[int, ...]  # extra unknowns that keep their value
    exposure: float  # centre of the exposure's prior [rows]
    dof: int

    def applied(
        self,
        normal: np.ndarray,
        gradient: np.ndarray,
        control: np.ndarray,
        exposure_rows: float,
        sigma: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """
        Add the beliefs to normal equations; unknowns that are fixed drop out.

        Parameters
        ----------
        normal : ndarray of shape (D, D)
            Lower triangle; D = knots * dof + EXTRA.
        gradient : ndarray of shape (D,)
        control : ndarray of shape (knots, 6)
            Path coordinates they were linearised at [px].
        exposure_rows : float
            Exposure they were linearised at [rows].
        sigma : float
            Standard deviation of the residuals [grey levels].

        """
        normal, gradient = normal.copy(), gradient.copy()
        control = control[:, : self.dof]
        path = control.size
        curvature = np.trace(normal[:path, :path]) / path + 1e-9
        belief = curvature * self.stiffness * _smoothness(len(control), self.dof)
        belief[np.diag_indices(path)] += _tilt_ridge(len(control), self.dof, sigma)
        normal[:path, :path] += belief
        gradient[:path] -= belief @ control.ravel()
        # damping keeps knots without data in place; it does not bias the solution
        normal[np.diag_indices(path)] += 1e-4 * curvature * min(1.0, 10 * self.stiffness) + 1e-9
        extra = np.arange(path, path + EXTRA)
        normal[extra, extra] += 1e-6 * normal[extra, extra] + 1e-6
        trust = (sigma / (EXPOSURE_SIGMA * self.exposure)) ** 2
        normal[path + 5, path + 5] += trust
        gradient[path + 5] -= trust * (exposure_rows - self.exposure)
        for index in self.fixed:
            at = path + index
            normal[at, :] = normal[:, at] = 0.0
            normal[at, at] = 1.0
            gradient[at] = 0.0
        return normal, gradient


@cache
def _smoothness(knots: int, dof: int) -> np.ndarray:
    """Penalty on slope and bend of each path coordinate, knots x coordinates interleaved."""
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    return np.kron(second.T @ second, np.diag(BEND[:dof])) + np.kron(
        first.T @ first, np.diag(SLOPE[:dof])
    )


def _tilt_ridge(knots: int, dof: int, sigma: float) -> np.ndarray:
    ridge = np.zeros((knots, dof))
    ridge[:, 4:] = (sigma / TILT_SIGMA) ** 2
    return ridge.ravel()
