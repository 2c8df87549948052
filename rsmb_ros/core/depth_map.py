"""The reference's depth, where it is known beforehand: layers parallel to the image (Eq. 6-10)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from .errors import FrameError

DEPTH_LOW, DEPTH_HIGH = 0.05, 20.0  # relative depths that are allowed
MOST_LAYERS = 32  # bits of a pixel's membership
FINEST_STEP = 0.005  # in 1/d; no layer is thinner: 0.08 px from its middle at 30 px of translation
SEAM = 3  # px that a layer goes on beneath a nearer one where the surface is continuous
SEAM_SHARE = 0.75  # of the step to the next layer, from which on a border is an edge ...
SEAM_STEP = 0.01  # ... unless it is less than this in 1/d: noise of the map
EDGE_STEP = 0.03  # in 1/d; what steps by more is an edge to the fit


def checked_depth(depth: Any, shape: tuple[int, ...]) -> np.ndarray:
    """
    Return a depth map as float32 once it may be used.

    Parameters
    ----------
    depth : ndarray of shape (M, N), floating
        Relative depth of each reference pixel, background = 1; NaN where it is not known.
    shape : tuple of int
        Rows and columns of the reference.

    Raises
    ------
    FrameError
        If it is no such array, or holds a value outside 0.05..20.

    """
    known = isinstance(depth, np.ndarray)
    if not known or depth.ndim != 2 or depth.dtype.kind != 'f':
        what = f'{depth.dtype} {depth.shape}' if known else type(depth).__name__
        raise FrameError(f'depth is {what}, must be float32 of shape (M, N), background = 1')
    if depth.shape != tuple(shape[:2]):
        raise FrameError(
            f'depth is {depth.shape[0]}x{depth.shape[1]} px but the reference is '
            f"{shape[0]}x{shape[1]} px: must be on the reference's grid"
        )
    with np.errstate(invalid='ignore'):
        wrong = ~np.isnan(depth) & ~((depth >= DEPTH_LOW) & (depth <= DEPTH_HIGH))
    if wrong.any():
        row, col = np.argwhere(wrong)[0]
        raise FrameError(
            f'depth at row {row}, column {col} is {depth[row, col]:g} ({wrong.sum()} such pixels), '
            f"must be {DEPTH_LOW:g} to {DEPTH_HIGH:g} times the background's, NaN where unknown"
        )
    if np.isnan(depth).all():
        raise FrameError('depth is NaN everywhere, must be known somewhere')
    return depth.astype(np.float32)


class DepthMap:
    """
    Layers of a reference whose depth is known; nearest first.

    Few distinct depths are layers as they are. Others are split where it matters most until
    `MOST_LAYERS` are reached or no layer is thicker than `FINEST_STEP` in 1/d: what a depth does to
    a pixel is proportional to that.

    Parameters
    ----------
    depth : ndarray of shape (M, N), float32
        From `checked_depth`.

    """

    def __init__(self, depth: np.ndarray) -> None:
        self.unknown = np.isnan(depth)  # (M, N) bool
        self.surface = _filled(1.0 / depth, self.unknown)  # (M, N) float32, 1/d, without holes
        values = np.sort(self.surface[~self.unknown].astype(np.float64))
        distinct = np.unique(values)
        self.exact = len(distinct) <= MOST_LAYERS
        if self.exact:
            layers, borders = distinct, (distinct[1:] + distinct[:-1]) / 2
        else:
            layers, borders = _split(values)
        self.inverse_depths = layers[::-1].copy()  # (L,) float64, 1/d
        number = len(layers) - 1 - np.searchsorted(borders, self.surface, side='right')
        self.members = self._memberships(number.astype(np.uint8))
        self._made: dict[tuple[str, int], np.ndarray] = {}

    @property
    def relative_depths(self) -> tuple[float, ...]:
        """Relative depth of each layer, nearest first."""
        return tuple(float(1.0 / inverse) for inverse in self.inverse_depths)

    def possible(self, radius: int) -> np.ndarray:
        """
        Layers that lie within `radius` px of each pixel, a bit each.

        uint32 of shape (M + 2 radius, N + 2 radius): there are `radius` px more on each side.
        """
        return self._once('possible', radius, lambda: self._spread(cv2.dilate, radius))

    def certain(self, radius: int) -> np.ndarray:
        """Return the layers that fill all of `radius` px around each pixel; see `possible`."""
        return self._once('certain', radius, lambda: self._spread(cv2.erode, radius))

    def smooth(self, radius: int) -> np.ndarray:
        """1/d (M, N) float32; 0 where it steps within `radius` px or is not known."""
        return self._once('smooth', radius, lambda: self._without_edges(radius))

    def uneven(self, radius: int) -> np.ndarray:
        """By how much 1/d differs within `radius` px of each pixel, (M, N) float32."""
        return self._once('uneven', radius, lambda: self._steps(radius))

    def _once(self, what: str, radius: int, make: Callable[[], np.ndarray]) -> np.ndarray:
        if (what, radius) not in self._made:
            self._made[what, radius] = make()
        return self._made[what, radius]

    def _memberships(self, number: np.ndarray) -> np.ndarray:
        """Bit n of each pixel (M, N) uint32: it is of layer n, whose numbers are `number`."""
        members = np.uint32(1) << number.astype(np.uint32)
        if self.exact:
            return members
        # layers of one surface must not part where they meet: no edge, nothing to see behind
        window = _square(SEAM)
        steps = -np.diff(self.inverse_depths)
        for behind in range(1, len(self.inverse_depths)):
            beside = cv2.dilate((number == behind).astype(np.uint8), window) > 0
            slight = max(SEAM_STEP, SEAM_SHARE * steps[behind - 1])
            near = (number < behind) & (self.surface - self.inverse_depths[behind] < slight)
            members[beside & near] |= np.uint32(1 << behind)
        return members

    def _spread(self, operation: Callable[..., np.ndarray], radius: int) -> np.ndarray:
        """Dilate or erode all layers, nothing around the reference."""
        around = cv2.copyMakeBorder(
            self.members.view(np.int32), *[radius] * 4, cv2.BORDER_CONSTANT, value=0
        ).view(np.uint32)
        window = _square(radius)
        spread = np.zeros_like(around)
        for n in range(len(self.inverse_depths)):
            own = ((around >> np.uint32(n)) & np.uint32(1)).astype(np.uint8)
            spread |= operation(own, window).astype(np.uint32) << np.uint32(n)
        return spread

    def _without_edges(self, radius: int) -> np.ndarray:
        hole = cv2.dilate(self.unknown.astype(np.uint8), _square(radius)) > 0
        return np.where((self._steps(radius) > EDGE_STEP) | hole, np.float32(0.0), self.surface)

    def _steps(self, radius: int) -> np.ndarray:
        highest = cv2.dilate(self.surface, _square(radius))
        return highest - cv2.erode(self.surface, _square(radius))


def _square(radius: int) -> np.ndarray:
    return np.ones((2 * radius + 1,) * 2, np.uint8)


def _filled(inverse: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """Return 1/d with that of the nearest known pixel where it is unknown."""
    if not unknown.any():
        return inverse
    _, nearest = cv2.distanceTransformWithLabels(
        unknown.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.empty(nearest.max() + 1, np.float32)
    of_label[nearest[~unknown]] = inverse[~unknown]
    return of_label[nearest]


def _split(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Split sorted values (n,) into layers: where it lessens the square error most, again and again.

    Returns the layers' values and the borders between them, both ascending. Equal steps would let
    one wrong pixel take all precision from the others.
    """
    sums = np.concatenate([[0.0], np.cumsum(values)])

    def best(first: int, last: int) -> tuple[float, int, int, int]:
        """Return what the best split of values[first:last] gains, and where it is."""
        if values[last - 1] - values[first] < FINEST_STEP:
            return 0.0, first, first, last
        at = np.arange(first + 1, last)
        left, right = sums[at] - sums[first], sums[last] - sums[at]
        gain = left**2 / (at - first) + right**2 / (last - at)
        best_at = int(np.argmax(gain))
        whole = (sums[last] - sums[first]) ** 2 / (last - first)
        return float(gain[best_at] - whole), first, int(at[best_at]), last

    pieces = [best(0, len(values))]
    while len(pieces) < MOST_LAYERS and max(pieces)[0] > 0.0:
        worst = max(pieces)
        pieces.remove(worst)
        _, first, middle, last = worst
        pieces += [best(first, middle), best(middle, last)]
    pieces.sort(key=lambda piece: piece[1])
    ends = [(first, last) for _, first, _, last in pieces]
    layers = np.array([np.median(values[first:last]) for first, last in ends])
    borders = np.array([(values[last - 1] + values[last]) / 2 for _, last in ends[:-1]])
    return layers, borders
