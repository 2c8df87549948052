"""One live frame as the report registers it: every row with poses and weights of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from .agreement import Agreement
from .config import Config
from .frame import RegisteredFrame
from .layers import NO_SHIFT
from .motion import CameraPath, Grid, coordinates_from_poses, still_path
from .reference import Reference
from .render import Shown, Window
from .row_estimator import RowEstimator
from .row_fit import RowFit
from .start import StripMatches, start_path
from .workers import Workers

KNOT_ROWS = 6.0  # of the path laid through the centroids
START_EXPOSURE = 0.0  # rows; the coarse start of rows knows of no exposure


class RowStage:
    """Solves the rows of live frames of one size against one reference."""

    def __init__(self, reference: Reference, grid: Grid, config: Config, executor: Workers) -> None:
        self._reference = reference
        self._grid = grid
        self._config = config
        self._executor = executor
        self._estimator = RowEstimator(
            reference.grey,
            grid,
            executor,
            degrees_of_freedom=config.registration.degrees_of_freedom,
            solver=config.registration.solver,
        )

    def frame(
        self, live: np.ndarray, grey: np.ndarray, matches: StripMatches, sharp: bool = False
    ) -> RowFrame:
        """Register one live frame, `grey` its grey levels (M, N) float32; `sharp` says nothing."""
        knots = self._config.registration.knot_rows
        bottom_up = self._config.shutter.readout == 'bottom_up'
        start = start_path(matches, self._grid, knots, START_EXPOSURE, 4.0, bottom_up)
        fit = self._estimator.estimate(grey, start.row_motion())
        path = path_through(fit.centroids, self._grid, bottom_up)
        return RowFrame(self._reference, live, grey, fit, path, self._executor)

    @staticmethod
    def look_at(grey: np.ndarray) -> None:
        """Prepare nothing: rows are taken as they are."""

    @staticmethod
    def shaken(refused: RegisteredFrame, matches: StripMatches) -> RegisteredFrame | None:
        """Return None: rows follow their neighbours however they shake."""
        return None

    @staticmethod
    def swept(frame: RegisteredFrame, found: Agreement) -> RegisteredFrame | None:
        """Return None: rows are swept already."""
        return None

    @staticmethod
    def refined(frame: RegisteredFrame, foreground: np.ndarray, still: float) -> RegisteredFrame:
        """Return the frame as it is: the report solves rows once."""
        return frame


class RowFrame(RegisteredFrame):
    """
    A live frame whose prediction is each row's weighted sum of warped reference rows (Eq. 2).

    Intensities are added as they are and the weights hold the gain, as in the report. What needs
    one pose a row (parallax, outlines of layers) takes the centroids.
    """

    def __init__(
        self,
        reference: Reference,
        live: np.ndarray,
        grey: np.ndarray,
        fit: RowFit,
        path: CameraPath,
        executor: Workers,
    ) -> None:
        self._rows = fit
        self._path = path
        super().__init__(reference, live, grey, executor)

    @property
    def path(self) -> CameraPath:
        """Path through the centroids, without an exposure."""
        return self._path

    @property
    def row_motion(self) -> np.ndarray:
        """Centroid pose tau_c of each row (M, 6)."""
        return self._rows.centroids

    @property
    def row_uncertainty(self) -> np.ndarray:
        """NaN (M,): a row solved alone has no Hessian to tell it."""
        return np.full(len(self._rows.centroids), np.nan)

    @property
    def exposure_rows(self) -> float:
        """NaN: rows have poses and weights, no exposure."""
        return float('nan')

    @property
    def gain(self) -> float:
        """Median sum of the weights of the solved rows, in display values."""
        sums = self._rows.weights.sum(axis=1)[self._rows.solved]
        return float(np.median(sums)) if sums.size else float('nan')

    def render(self, depth: float, window: Window, shift: tuple[float, float] = NO_SHIFT) -> Shown:
        """Show a layer at relative depth `depth`, moved by `shift` x, y [px], in grey."""
        poses = self._rows.poses.copy()
        poses[..., :2] += depth * np.asarray(shift)  # layers move by t / d
        rows = replace(self._rows, poses=poses)
        image, complete = rows.render(self._reference.fine_grey, depth, self._executor)
        known = complete & self._known[:, None]
        return Shown(np.clip(image[window.box], 0.0, 255.0), None, known[window.box])

    @cached_property
    def _known(self) -> np.ndarray:
        """Rows (M,) that were solved or lie between solved ones."""
        at = np.flatnonzero(self._rows.solved)
        known = np.zeros(len(self._rows.solved), bool)
        if at.size:
            known[at[0] : at[-1] + 1] = True
        return known

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8, grey."""
        image = self.predicted * self.complete
        channels = self._reference.image.shape[2:]
        if channels:
            image = np.repeat(image[..., None], channels[0], axis=2)
        return np.rint(image).astype(np.uint8)


def path_through(poses: np.ndarray, grid: Grid, bottom_up: bool) -> CameraPath:
    """Return the smooth path through one pose a row (M, 6), its exposure 0."""
    path = still_path(grid, KNOT_ROWS, 0.0, 4.0, bottom_up)
    basis = path.spline_basis(path.row_times)
    target = coordinates_from_poses(poses, grid)
    control, *_ = np.linalg.lstsq(basis, target, rcond=1e-6)
    return replace(path, control=control)
