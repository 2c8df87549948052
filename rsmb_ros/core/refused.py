"""What no depth explained, so that a later look at the same frame need not ask again."""

from __future__ import annotations

import numpy as np

from .motion import CameraPath
from .segmentation import Blob

SAME = 0.9  # overlap of an object with what it was at an earlier look
STILL = 0.25  # px that the path may have moved since then


class Refused:
    """Objects that no depth explained, for later looks at the same frame."""

    def __init__(self) -> None:
        self._known: list[tuple[Blob, np.ndarray]] = []

    def add(self, blob: Blob, path: CameraPath) -> None:
        """Remember an object that nothing explained on this path."""
        self._known.append((blob, _course(blob, path)))

    def __contains__(self, asked: tuple[Blob, CameraPath]) -> bool:
        """Whether as good as the same object was refused on as good as the same path."""
        blob, path = asked
        same = [course for known, course in self._known if _overlap(known, blob) > SAME]
        if not same:
            return False
        own = _course(blob, path)
        return any(np.hypot(*(own - course).T).max() < STILL for course in same)


def _course(blob: Blob, path: CameraPath) -> np.ndarray:
    """Where the path has a blob's first, middle and last row (3, 2) [px]."""
    rows = blob.y + np.linspace(0, blob.mask.shape[0] - 1, 3).astype(np.int64)
    return path.coordinates(path.row_times[rows])[:, :2]


def _overlap(a: Blob, b: Blob) -> float:
    """Shared area of two blobs over that of both together, 0..1."""
    top, left = max(a.y, b.y), max(a.x, b.x)
    bottom = min(a.y + a.mask.shape[0], b.y + b.mask.shape[0])
    right = min(a.x + a.mask.shape[1], b.x + b.mask.shape[1])
    if bottom <= top or right <= left:
        return 0.0
    parts = (one.mask[top - one.y : bottom - one.y, left - one.x : right - one.x] for one in (a, b))
    shared = int(np.count_nonzero(np.logical_and(*parts)))
    return shared / (a.area + b.area - shared)
