"""Masks as the paths of an SVG: sharp at any size, and a hundredth of a picture's bytes."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

MOST_POINTS = 1500  # in one path; about 12 kB
_TOLERANCE = 0.7  # px an outline may be off
_COARSER = 2.0  # times the tolerance, where a path has too many points

# Moves points (n, 2), x and y [px].
Move = Callable[[np.ndarray], np.ndarray]


def outline_path(
    mask: np.ndarray,
    least_area: float = 0.0,
    move: Move | None = None,
    most_points: int = MOST_POINTS,
) -> str:
    """
    Return the outlines of a mask, with their holes, as an SVG path for ``fill-rule: evenodd``.

    Parameters
    ----------
    mask : ndarray of shape (M, N), bool or uint8
        Everything that is not 0.
    least_area : float
        Smaller pieces and holes are left out [px^2].
    move : callable, optional
        From the pixels of the mask to the coordinates of the path.
    most_points : int
        A path with more is made coarser, and in the end the smallest pieces are left out.

    """
    filled = (mask != 0).astype(np.uint8)
    found, _ = cv2.findContours(filled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    areas = [cv2.contourArea(contour) for contour in found]
    order = sorted(range(len(found)), key=lambda n: (-areas[n], n))
    kept = [found[n] for n in order if areas[n] >= least_area][: most_points // 3]
    tolerance = _TOLERANCE
    simple = [cv2.approxPolyDP(contour, tolerance, True) for contour in kept]
    while sum(map(len, simple)) > most_points and tolerance < max(mask.shape):
        tolerance *= _COARSER
        simple = [cv2.approxPolyDP(contour, tolerance, True) for contour in kept]
        simple = [contour for contour in simple if len(contour) > 2]
    return ''.join(_closed(contour[:, 0].astype(float), move) for contour in simple)


def _closed(points: np.ndarray, move: Move | None) -> str:
    moved = points if move is None else move(points)
    if not np.isfinite(moved).all():
        return ''
    return 'M' + 'L'.join(f'{x:.4g} {y:.4g}' for x, y in moved) + 'Z'
