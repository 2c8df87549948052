"""Which depth map belongs to which reference: the one with its stamp and its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pair:
    """A reference with its depth, if that is known."""

    image: np.ndarray  # (M, N) or (M, N, 3) uint8
    depth: np.ndarray | None = None  # (M, N) float32, relative


@dataclass(frozen=True)
class _Stamped:
    array: np.ndarray
    stamp_ns: int


class Pairing:
    """
    Puts images and depth maps together, in whatever order and however often they come.

    An image that is repeated with other stamps stays the reference it is, with its depth.
    """

    def __init__(self) -> None:
        self._image: _Stamped | None = None
        self._depth: _Stamped | None = None
        self._given: Pair | None = None

    def image(self, array: np.ndarray, stamp_ns: int) -> Pair | None:
        """Take a reference image; return what is to be used from now on, None: as before."""
        self._image = _Stamped(array, stamp_ns)
        return self._changed()

    def depth(self, array: np.ndarray, stamp_ns: int) -> Pair | None:
        """Take a depth map (M, N) float32; return what is to be used from now on, None: as was."""
        self._depth = _Stamped(array, stamp_ns)
        return self._changed()

    def waiting(self) -> str:
        """Say why the last depth map is not in use, '' when it is."""
        image, depth = self._image, self._depth
        if depth is None or self._fits():
            return ''
        if image is None:
            return 'there is no reference yet'
        if image.stamp_ns != depth.stamp_ns:
            return (
                f'its stamp is {depth.stamp_ns} ns, that of the reference {image.stamp_ns} ns: '
                'must be equal'
            )
        rows, cols = image.array.shape[:2]
        return (
            f'it is {depth.array.shape[0]}x{depth.array.shape[1]} px, the reference '
            f'{rows}x{cols} px: must be equal'
        )

    def _fits(self) -> bool:
        image, depth = self._image, self._depth
        return (
            image is not None
            and depth is not None
            and image.stamp_ns == depth.stamp_ns
            and image.array.shape[:2] == depth.array.shape
        )

    def _changed(self) -> Pair | None:
        if self._image is None:
            return None
        depth = self._depth.array if self._depth is not None and self._fits() else None
        pair = Pair(self._image.array, depth)
        if self._given is not None and _says_no_more(pair, self._given):
            return None
        self._given = pair
        return pair


def _says_no_more(pair: Pair, given: Pair) -> bool:
    """Whether `pair` holds the image of `given`, and its depth or none."""
    if pair.image is not given.image and not np.array_equal(pair.image, given.image):
        return False
    if pair.depth is None or given.depth is None:
        return pair.depth is None
    return np.array_equal(pair.depth, given.depth, equal_nan=True)
