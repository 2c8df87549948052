"""The path a fit starts from: smooth, laid through what the coarse search has matched."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from ._kernels.fit_row import AHEAD
from ._kernels.start import COORDINATES, laid_through, mean_weights
from .motion import CameraPath, Grid, still_path

FEWEST = 6  # pieces that more than one offset is laid through
ROUNDS = 6  # of the robust least squares
SPLINE_SAMPLES = 8  # instants per exposure
LEAST_SIGMA = 1.0  # px, of misfits
# Weights of bend, slope and size of each coordinate: offsets may bend, rotation and zoom hardly
# change in a frame.
PRIORS = np.array([(0.005, 0.01, 1e-9), (0.005, 0.01, 1e-9), (0.2, 2.0, 1e-3), (0.2, 4.0, 1e-2)])


@dataclass(frozen=True)
class StripMatches:
    """Displacements of n pieces of rows, in full-size pixels from the image centres."""

    place: np.ndarray  # (n, 2) centre X, Y of the piece in the live image [px from the centre]
    shift: np.ndarray  # (n, 2) reference place - live place [px]
    weight: np.ndarray  # (n, 2) trust in the two components, >= 0
    offset: np.ndarray  # (2,) global vote: where the live centre lies [px from the ref. centre]


def start_path(
    matches: StripMatches,
    grid: Grid,
    knot_rows: float,
    exposure_rows: float,
    longest_exposure: float,
    bottom_up: bool,
) -> CameraPath:
    """
    Lay a smooth path (offset, rotation, zoom) through the matches by robust least squares.

    With fewer than six matches the path is the global offset alone.
    """
    path = still_path(grid, knot_rows, exposure_rows, longest_exposure, bottom_up)
    path.control[:, :2] = matches.offset
    if len(matches.place) < FEWEST:
        return path
    row = np.clip(matches.place[:, 1] + grid.center[1], 0, grid.live_shape[0] - 1)
    times = np.interp(row, np.arange(grid.live_shape[0]), path.row_times)
    solution = _laid_through(matches, path, times).reshape(-1, COORDINATES).T
    path.control[:, :2] = solution[:2].T
    # the equations are linear in s sin(r) and s cos(r) - 1
    turned, grown = solution[2:] / grid.half_width
    path.control[:, 2] = grid.half_width * np.arctan2(turned, 1.0 + grown)
    path.control[:, 3] = grid.half_width * (np.hypot(turned, 1.0 + grown) - 1.0)
    return path


def _laid_through(matches: StripMatches, path: CameraPath, times: np.ndarray) -> np.ndarray:
    """Return the `COORDINATES` of each knot in turn, for pieces in the middles of `times` (n,)."""
    knots, count = len(path.control), len(times)
    first = np.zeros(count, np.int64)
    weights = np.zeros((count, math.ceil(path.exposure_rows / path.knot_rows) + 5))
    mean_weights(
        times, SPLINE_SAMPLES, path.exposure_rows, path.first_time, path.knot_rows, knots, first,
        weights,
    )  # fmt: skip
    unknowns = knots * COORDINATES
    prior = np.zeros((unknowns, max(3, weights.shape[1]) * COORDINATES))
    prior[:, : 3 * COORDINATES] = _smoothness(knots)
    solution = np.empty(unknowns + AHEAD)
    laid_through(
        first, weights, matches.place / path.grid.half_width,
        np.ascontiguousarray(matches.shift), np.ascontiguousarray(matches.weight),  # compiled once
        prior, ROUNDS, LEAST_SIGMA, solution,
    )  # fmt: skip
    return solution[:unknowns]


@cache
def _smoothness(knots: int) -> np.ndarray:
    """Return the band (D, 3 `COORDINATES`) of the start's prior."""
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    bend, slope, size = PRIORS.T
    band = np.zeros((knots, COORDINATES, 3, COORDINATES))
    penalties = ((second.T @ second, bend), (first.T @ first, slope), (np.eye(knots), size))
    for penalty, weight in penalties:
        for ahead in range(3):
            band[: knots - ahead, :, ahead, 0] += np.diag(penalty, ahead)[:, None] * weight
    return band.reshape(knots * COORDINATES, 3 * COORDINATES)
