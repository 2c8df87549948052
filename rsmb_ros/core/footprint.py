"""Where the regions of a live frame lie on the reference, and the other way round."""

from __future__ import annotations

import cv2
import numpy as np

from .motion import Grid
from .segmentation import Blob

ROUNDS = 6  # from reference to live row; the error shrinks by the image's motion a row, < 1/2 px


def on_reference(blob: Blob, homographies: np.ndarray, grid: Grid) -> Blob:
    """
    Return what a connected blob of the live frame covers of the reference.

    Its outline is mapped, row by row, and filled: no gaps where the reference is finer.

    Parameters
    ----------
    blob : Blob
        In the live frame.
    homographies : ndarray of shape (M, 3, 3)
        Of each live row, see `CameraPath.row_homographies`.
    grid : Grid

    """
    outlines, _ = cv2.findContours(
        blob.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    live = np.concatenate(outlines)[:, 0] + (blob.x, blob.y)
    center = grid.center
    mapped = _mapped(homographies[live[:, 1]], live - center[:2]) + center[2:]
    points = np.rint(mapped).astype(np.int32)
    corner = points.min(axis=0)
    width, height = points.max(axis=0) - corner + 1
    mask = np.zeros((height, width), np.uint8)
    ends = np.cumsum([len(outline) for outline in outlines])[:-1]
    cv2.fillPoly(mask, np.split(points - corner, ends), 1)
    return Blob(mask > 0, int(corner[0]), int(corner[1]))


def judged_at(
    points: np.ndarray, homographies: np.ndarray, grid: Grid, judged: np.ndarray
) -> np.ndarray:
    """
    Say which points of the reference a live frame judges, (n,) bool.

    Parameters
    ----------
    points : ndarray of shape (n, 2), float64
        x, y on the reference [px].
    homographies : ndarray of shape (M, 3, 3)
        Of each live row, see `CameraPath.row_homographies`.
    grid : Grid
    judged : ndarray of shape (M, N), bool
        Pixels of the live frame.

    """
    rows, cols = judged.shape
    inverse = np.linalg.inv(homographies)
    center = grid.center
    row = np.full(len(points), rows // 2)
    for _ in range(ROUNDS):  # each row has a pose of its own: which one sees the point?
        live = _mapped(inverse[row], points - center[2:]) + center[:2]
        row = np.clip(np.rint(live[:, 1]), 0, rows - 1).astype(np.int64)
    x, y = np.rint(live).astype(np.int64).T
    known = (x >= 0) & (x < cols) & (y >= 0) & (y < rows)
    known[known] = judged[y[known], x[known]]
    return known


def overlap(one: Blob, other: Blob) -> int:
    """Count the pixels that two blobs of one image have in common."""
    left, top = max(one.x, other.x), max(one.y, other.y)
    right = min(one.x + one.mask.shape[1], other.x + other.mask.shape[1])
    bottom = min(one.y + one.mask.shape[0], other.y + other.mask.shape[0])
    if left >= right or top >= bottom:
        return 0
    parts = [
        blob.mask[top - blob.y : bottom - blob.y, left - blob.x : right - blob.x]
        for blob in (one, other)
    ]
    return int(np.count_nonzero(parts[0] & parts[1]))


def _mapped(homographies: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map centred points (n, 2), each by its homography (n, 3, 3)."""
    u, v, w = np.einsum('nij,nj->in', homographies, np.c_[points, np.ones(len(points))])
    return np.stack([u / w, v / w], axis=1)
