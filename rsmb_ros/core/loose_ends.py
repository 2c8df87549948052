"""
Mend the ends of a path: rows that have nothing beyond them to hold them to their neighbours.

A shaken camera moves pixels between the last rows that fit and the edge of the frame; from there a
fit can slide into a wrong minimum. Such an end is followed anew, a few rows at a time, from the
rows that fit: as the report sweeps its rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np

from .motion import CameraPath
from .path_estimator import PathEstimator
from .path_fit import PathFit
from .points import LiveImage, Points
from .row_refinement import Frame

WINDOW = 3  # rows that are looked at together
MISFIT = 2.5  # times the usual residual of a row that misfits ...
LEAST = 3.0  # ... and grey levels at least
KNOWN = 0.1  # of a row that must be judged
FEWEST = 3  # rows that are worth the time
MOST = 0.25  # of the frame; more is no end
BEFORE = 3  # rows before an end that may be off already
STEP = 3  # rows that are followed at a time
ITERATIONS = (4, 8)  # at each sweep, and with all rows
STIFF = 1e-2  # of the third difference, where nothing else says how a path goes on
GAIN = 0.01  # share of the misfit that must go

AnyFrame = TypeVar('AnyFrame', bound=Frame)


def mended(
    frame: AnyFrame,
    live: LiveImage,
    estimator: PathEstimator,
    build: Callable[[PathFit], AnyFrame],
) -> AnyFrame:
    """
    Return the frame by a path whose ends were followed anew, or as it is.

    Parameters
    ----------
    frame : Frame
        As fitted.
    live : LiveImage
        What the fit sees of it.
    estimator : PathEstimator
        What fitted it.
    build : callable
        Makes the frame of a fit.

    """
    loose, fit = loose_rows(frame), frame.fit
    if not loose.any():
        return frame
    points = live.points(1)[0]
    while loose.any():
        start = replace(fit, path=_laid_anew(fit.path, loose))
        loose = _shrunk(loose, STEP)
        fit = _fitted(points.only(~loose[points.rows][:, None]), start, estimator, ITERATIONS[0])
    fit = _fitted(points, fit, estimator, ITERATIONS[1])
    return build(fit) if fit.cost < (1.0 - GAIN) * frame.fit.cost else frame


def _fitted(points: Points, start: PathFit, estimator: PathEstimator, most: int) -> PathFit:
    level = estimator.level_fit(0, points, start.path)
    return level.run(start, not start.exposure_held, most, near=True)


def loose_rows(frame: Frame) -> np.ndarray:
    """Rows (M,) bool from either edge of the frame inwards that misfit, and a few more."""
    known = frame.judged.sum(axis=1)
    seen = np.flatnonzero(known > KNOWN * frame.judged.shape[1])
    loose = np.zeros(len(known), bool)
    if not seen.size:
        return loose
    row = (np.abs(frame.residual) * frame.judged).sum(axis=1) / np.maximum(known, 1)
    off = cv2.blur(row[:, None], (1, WINDOW))[:, 0] > max(LEAST, MISFIT * np.median(row[seen]))
    for inwards in (seen, seen[::-1]):
        # from the edge to the last row that misfits before most fit
        share = np.cumsum(off[inwards]) / np.arange(1, len(inwards) + 1)
        misfits = np.flatnonzero(off[inwards[: int(np.argmax(share < 0.5))]])
        if len(misfits) >= FEWEST and misfits[-1] < MOST * len(inwards):
            loose[inwards[: misfits[-1] + 1 + BEFORE]] = True
    if loose.any():  # what is not seen lies beyond
        loose[: seen[0]] = loose[seen[0]]
        loose[seen[-1] :] = loose[seen[-1]]
    return loose


def _shrunk(loose: np.ndarray, step: int) -> np.ndarray:
    """Take `step` rows off the inner side of each end."""
    fits = cv2.dilate((~loose).astype(np.uint8)[:, None], np.ones((2 * step + 1, 1), np.uint8))
    return fits[:, 0] == 0


def _laid_anew(path: CameraPath, loose: np.ndarray) -> CameraPath:
    """Return the path with its control points near `loose` rows as the others let expect."""
    basis = path.spline_basis(path.row_times)
    held = ~(basis[loose] > 0.3).any(axis=0) & (basis[~loose] > 0.0).any(axis=0)
    bend = np.diff(np.eye(len(held)), 3, axis=0)
    normal = STIFF * bend.T @ bend + np.diag(held + 1e-9)
    control = np.linalg.solve(normal, held[:, None] * path.control)
    return replace(path, control=control)
