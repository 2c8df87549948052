"""What is believed of a camera path before the data are seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ._kernels.fit_row import AHEAD
from ._kernels.normal import Beliefs, believe
from .arrow import Arrow

# How reluctantly each path coordinate bends and changes; a row alone hardly sees the tilt.
BEND = np.array([0.1, 0.1, 0.2, 0.4, 2.0, 2.0])
SLOPE = np.array([0.0, 0.0, 0.0, 0.05, 2.0, 8.0])
TILT_SIGMA = 4.0  # px at half width, prior on the perspective terms (1.3 deg at f = 0.9 width)
EXPOSURE_SIGMA = 0.3  # relative prior on the exposure while it is estimated


@dataclass(frozen=True)
class Priors:
    """What is believed before the data are seen."""

    fixed: tuple[int, ...]  # extra unknowns that keep their value
    exposure: float  # centre of the exposure's prior [rows]
    dof: int

    def applied(
        self,
        normal: Arrow,
        gradient: np.ndarray,
        stiffness: float,
        control: np.ndarray,
        exposure_rows: float,
        sigma: float,
    ) -> tuple[Arrow, np.ndarray]:
        """
        Add the beliefs to normal equations; unknowns that are fixed drop out.

        Parameters
        ----------
        normal : Arrow
            Of D = knots * dof unknowns.
        gradient : ndarray of shape (D + AHEAD,)
        stiffness : float
        control : ndarray of shape (knots, 6)
            Path coordinates they were linearised at [px].
        exposure_rows : float
            Exposure they were linearised at [rows].
        sigma : float
            Standard deviation of the residuals [grey levels].

        """
        normal, gradient = normal.copy(), gradient.copy()
        beliefs = self.on(len(control))
        believe(beliefs, stiffness, control, exposure_rows, sigma, *normal.parts, gradient)
        return normal, gradient

    def on(self, knots: int) -> Beliefs:
        """Return what the kernels take of it, for a path of so many control points."""
        ridge = np.zeros(self.dof)
        ridge[4:] = TILT_SIGMA**-2
        trust = (EXPOSURE_SIGMA * self.exposure) ** -2
        return Beliefs(
            smoothness(knots, self.dof), ridge, trust, self.exposure, _marked(self.fixed)
        )


@cache
def _marked(fixed: tuple[int, ...]) -> np.ndarray:
    """Return which of the extras are `fixed`, (AHEAD,) bool."""
    mask = np.zeros(AHEAD, bool)
    mask[list(fixed)] = True
    return mask


@cache
def smoothness(knots: int, dof: int) -> np.ndarray:
    """
    Return the penalty on slope and bend of each path coordinate (knots, 3, dof).

    Element (k, d) couples knot k with knot k + d.
    """
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    bands = np.zeros((knots, 3, dof))
    for differences, weight in ((second, BEND), (first, SLOPE)):
        penalty = differences.T @ differences
        for ahead in range(3):
            bands[: knots - ahead, ahead] += np.diag(penalty, ahead)[:, None] * weight[:dof]
    return bands
