"""
Mend the ends of a path: rows that have nothing beyond them to hold them to their neighbours.

A shaken camera moves pixels between the last rows that fit and the edge of the frame; from there a
fit can slide into a wrong minimum. The rows of such an end are then matched one after another, from
those that fit outwards, each near where the one before lets it be: as the report sweeps its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np

from ._kernels.pixels import row_misfits
from .coarse import sub_pixel_peak
from .lost_rows import MOST, lost_rows
from .motion import CameraPath, shifted
from .path_estimator import PathEstimator
from .path_fit import PathFit
from .points import LiveImage
from .row_refinement import Frame

WINDOW = 3  # rows that are looked at together
MISFIT = 2.5  # times the usual residual of a row that misfits ...
LEAST = 3.0  # ... and grey levels at least
KNOWN = 0.1  # of a row that must be judged
FITS = 16  # rows in turn that fit: what misfits beyond them is no end
FEWEST = 3  # rows that are worth the time
BEFORE = 8  # rows before an end that may be off already
STRIP = 5  # rows that are matched as one
REACH = 4  # px around the place that the strip before lets expect
MARGIN = 24  # px beyond the frame that an end may show
PATIENCE = 3  # strips in turn that may match nowhere
NARROWEST = 0.25  # of the frame's width that must be comparable
SWEEP = 0.5  # share of a strip's own motion in what is expected of the next
STIFF = 1e-2  # of the third difference, where nothing else says how a path goes on
ITERATIONS = 8  # of the fit from there
GAIN = 0.01  # share of the misfit that must go, ...
STILL_USED = 0.98  # ... not by leaving the reference, ...
FEWER = 0.5  # ... and share of the loose rows that may stay: a shadow or an object loosens rows too

AnyFrame = TypeVar('AnyFrame', bound=Frame)


def mended(
    frame: AnyFrame,
    live: LiveImage,
    estimator: PathEstimator,
    build: Callable[[PathFit], AnyFrame],
) -> AnyFrame:
    """
    Return the frame by a path whose ends were followed anew, or as it is.

    Ends that nothing brings back are `PathFit.lost`.

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
    loose = loose_rows(frame)
    if not loose.any():
        return frame
    followed = _anew(frame, live, estimator, build, loose)
    if followed is not None:
        return followed
    lost = lost_rows(frame, live.grey)
    return build(replace(frame.fit, lost=lost)) if lost.any() else frame


def _anew(
    frame: AnyFrame,
    live: LiveImage,
    estimator: PathEstimator,
    build: Callable[[PathFit], AnyFrame],
    loose: np.ndarray,
) -> AnyFrame | None:
    """Follow the `loose` rows (M,) bool of a frame, see `mended`; None if that does not help."""
    path = frame.fit.path
    held = np.flatnonzero(~loose)
    for last, outwards in ((held[0], -1), (held[-1], 1)):
        if not loose[0 if outwards < 0 else -1]:
            continue
        still = _still(frame.fit.path, last)
        ahead = build(replace(frame.fit, path=shifted(still, 1.0, (0.0, outwards * MARGIN))))
        turn = still.row_homographies()[last, :2, :2]
        inwards = min(max(last - outwards * STRIP, held[0]), held[-1])
        places = path.row_centroids()[[inwards, last], :2]
        speed = np.linalg.solve(turn, places[1] - places[0])
        rows, moved = _followed(live.grey, ahead, last, outwards, speed)
        end = np.arange(len(loose)) * outwards > last * outwards
        path = _laid_anew(path, end, still.control[0], rows, moved @ turn.T)
    start = replace(frame.fit, path=path)
    level = estimator.level_fit(0, live.points(1)[0], path)
    fit = level.run(start, not start.exposure_held, ITERATIONS, near=True)
    if fit.cost > (1.0 - GAIN) * frame.fit.cost or fit.used < STILL_USED * frame.fit.used:
        return None
    again = build(fit)
    return again if loose_rows(again).sum() < FEWER * loose.sum() else None


def loose_rows(frame: Frame) -> np.ndarray:
    """Rows (M,) bool from either edge of the frame inwards that misfit, and a few more."""
    known, total = np.empty(len(frame.judged), np.int64), np.empty(len(frame.judged))
    row_misfits(frame.residual, frame.judged, known, total)
    seen = np.flatnonzero(known > KNOWN * frame.judged.shape[1])
    loose = np.zeros(len(known), bool)
    if not seen.size:
        return loose
    row = total / np.maximum(known, 1)
    off = cv2.blur(row[:, None], (1, WINDOW))[:, 0] > max(LEAST, MISFIT * np.median(row[seen]))
    for inwards in (seen, seen[::-1]):
        # from the edge to the last row that misfits before most fit, or some in turn
        share = np.cumsum(off[inwards]) / np.arange(1, len(inwards) + 1)
        in_turn = np.convolve(~off[inwards], np.ones(FITS), 'valid') >= FITS
        end = min(
            int(np.argmax(share < 0.5)), int(np.argmax(in_turn)) if in_turn.any() else len(seen)
        )
        misfits = np.flatnonzero(off[inwards[:end]])
        if len(misfits) >= FEWEST and misfits[-1] < MOST * len(inwards):
            loose[inwards[: misfits[-1] + 1 + BEFORE]] = True
    if loose.any():  # what is not seen lies beyond
        loose[: seen[0]] = loose[seen[0]]
        loose[seen[-1] :] = loose[seen[-1]]
    return loose


def _still(path: CameraPath, row: int) -> CameraPath:
    """Return a path that stays where it is in the middle of a row's exposure."""
    place = path.coordinates(path.row_times[[row]])
    return replace(path, control=np.repeat(place, len(path.control), axis=0))


def _followed(
    grey: np.ndarray, ahead: Frame, last: int, outwards: int, speed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Match strips of a live frame `grey` (M, N), from row `last` outwards.

    `ahead` shows what lies `MARGIN` px outwards of the place of that row, the camera being still;
    `speed` (2,) is how far the rows before moved within a strip [px].
    Returns middle rows (n,) and how far they have moved from there (n, 2) [px].
    """
    found = list(_places(grey, ahead, last, outwards, speed))
    return np.array([row for row, _ in found]), np.reshape([place for _, place in found], (-1, 2))


def _places(
    grey: np.ndarray, ahead: Frame, last: int, outwards: int, speed: np.ndarray
) -> Iterator[tuple[float, np.ndarray]]:
    rows, cols = grey.shape
    whole = ahead.judged
    place, failed = -0.5 * speed, 0  # of the strip before, whose middle lies inwards
    top = last if outwards > 0 else last - STRIP + 1
    while -STRIP < top < rows and failed < PATIENCE:
        top = min(max(top, 0), rows - STRIP)
        guess = place + speed
        x, y = np.rint(guess).astype(int)
        first = top + y - outwards * MARGIN - REACH
        window = np.s_[first : first + STRIP + 2 * REACH]
        if first < 0 or window.stop > rows:
            return
        left, right = _longest_run(whole[window].all(axis=0))
        # columns of the strip that find all their reach within
        begin, end = max(0, left - x + REACH), min(cols, right - x - REACH)
        peak = None
        if end - begin > NARROWEST * cols:
            strip = grey[top : top + STRIP, begin:end]
            around = ahead.predicted[window, begin + x - REACH : end + x + REACH]
            scores = cv2.matchTemplate(around, strip, cv2.TM_CCOEFF_NORMED)
            peak = sub_pixel_peak(np.nan_to_num(scores, posinf=0.0, neginf=0.0))
        if peak is None:
            place, failed = guess, failed + 1
        else:
            found = np.array([x, y]) + np.array(peak[:2]) - REACH
            speed = (1.0 - SWEEP) * speed + SWEEP * (found - place)
            place, failed = found, 0
            yield top + 0.5 * (STRIP - 1), place
        top += outwards * STRIP


def _longest_run(wanted: np.ndarray) -> tuple[int, int]:
    """Begin and end of the longest run of True in (n,) bool."""
    edges = np.diff(np.concatenate([[0], wanted.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    if not begins.size:
        return 0, 0
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def _laid_anew(
    path: CameraPath, end: np.ndarray, still: np.ndarray, rows: np.ndarray, moved: np.ndarray
) -> CameraPath:
    """
    Return the path with its control points near an `end` (M,) bool laid anew.

    They rest at the coordinates `still` (6,) but for the offset, which has `moved` (n, 2) [px] at
    `rows` (n,) and goes on smoothly from there.
    """
    basis = path.spline_basis(path.row_times)
    weight, elsewhere = basis[end].max(axis=0), basis[~end].max(axis=0)
    free = (weight > 0.3) | (weight > 0.0) & (elsewhere <= 0.0)
    control = path.control.copy()
    control[free] = still
    at = path.spline_basis(np.interp(rows, np.arange(len(path.row_times)), path.row_times))
    bend = np.diff(np.eye(len(free)), 2, axis=0)
    normal = at.T @ at + STIFF * bend.T @ bend
    offset = control[:, :2]
    target = at.T @ (still[:2] + moved)
    offset[free] = np.linalg.solve(
        normal[np.ix_(free, free)] + 1e-9 * np.eye(free.sum()),
        target[free] - normal[np.ix_(free, ~free)] @ offset[~free],
    )
    return replace(path, control=control)
