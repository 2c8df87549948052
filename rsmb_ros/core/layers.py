"""
Static objects at other depths (Algorithm 1 of the report).

Each object the background does not explain is rendered again with the same camera path and its
translation scaled by a relative depth; where one depth explains a large part of it, that part was
in the reference all along. What such an object uncovers or half covers cannot be judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from .config import ChangeConfig, LayersConfig
from .evidence import evidence
from .motion import CameraPath, shifted
from .render import Window, blurred
from .sampling import half_pixel
from .segmentation import Blob, hysteresis

COARSE_STEP = 0.05
FINE_STEPS = (0.025, 0.0125, 0.006, 0.003, 0.0015)
PAD = 6  # px around an object that is rendered with it
UNSEEN_Z = 9.0  # normalised residual of a pixel that a depth cannot show
MAX_Z2 = 16.0  # truncation of the energy that depths are compared by
EXPLAINED = 2.2  # evidence below which a pixel is explained [sigma]
MIN_PARALLAX = 0.4  # px; less than that and no depth can be told from the background
MIN_SHARE = 0.13  # of the object that must be explained
MIN_CORE = 4.2e-4  # of the frame: largest connected explained part (130 px at 640x480)
MIN_CORRELATION = 0.6  # of prediction and live on the object ...
SURE_SHARE = 0.5  # ... unless this share is explained
ALIKE = 0.9  # correlation of an object that may fit less well than its surroundings ...
MAX_MISFIT = 2.5  # ... by so much
MAX_ENERGY_RATIO = 0.85  # of the energy at the background's depth
MAX_SHIFT = 0.5  # of an object's parallax: tilt and translation are not told apart better
SHIFT_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)
GAP = 0.04  # of the width: gaps in an object's outline that still belong to it
EDGE = 9  # px: an object's outline is known to half of this
RIM = 0.02  # share of the exposure that makes a pixel a rim

NO_SHIFT = (0.0, 0.0)

# (depth, window, shift) -> predicted display values, where they hold
Render = Callable[[float, Window, tuple[float, float]], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Layer:
    """One static object at its depth."""

    blob: Blob  # the part of the live image it explains
    sure: np.ndarray  # bool, shape of the blob's mask: not what it uncovers
    relative_depth: float  # d_l
    share: float  # of the object that the depth explains, 0..1
    shift: tuple[float, float] = NO_SHIFT  # x, y beyond what the depth does to it [px]
    misfit: float = 1.0  # >= 1, its residuals over the frame's noise: rich texture fits less well


_NOTHING = Blob(np.zeros((0, 0), bool), 0, 0)


@dataclass(frozen=True)
class DepthSearch:
    """Judges objects of one frame against the reference at other depths."""

    live: np.ndarray  # (M, N) float32 display values
    sigma: Callable[[np.ndarray], np.ndarray]  # predicted image -> noise [grey levels]
    render: Render
    path: CameraPath
    config: LayersConfig
    change: ChangeConfig

    def explain(self, blob: Blob, known: Sequence[Layer] = ()) -> Layer | None:
        """
        Return the layer that explains `blob`, None when it is a change.

        `known` layers come from an earlier look at the same frame: near one of them its depth
        and a little around it is tried before all others.
        """
        window, mask = self._windowed(blob)
        near = [layer for layer in known if _touch(window, _padded(layer.blob, self.live.shape))]
        if near:
            depths = np.array([layer.relative_depth for layer in near])
            layer = self._explained_at(depths, blob, window, mask)
            if layer is not None:
                return layer
        depths = np.arange(self.config.depth_min, self.config.depth_max + 1e-9, COARSE_STEP)
        return self._explained_at(depths, blob, window, mask)

    def _explained_at(
        self, depths: np.ndarray, blob: Blob, window: Window, mask: np.ndarray
    ) -> Layer | None:
        """Return the layer that explains `blob` near one of these depths."""
        depth, energy = self._best_depth(window, mask, depths)
        if self._parallax(blob, depth) < MIN_PARALLAX:
            return None
        if energy >= MAX_ENERGY_RATIO * self._energy(1.0, window, mask):
            return None
        layer, share = self._judged(depth, NO_SHIFT, window, mask)
        if share > SURE_SHARE:
            return layer
        shift = self._shift(depth, window, mask, 1.0 + MAX_SHIFT * self._parallax(blob, depth))
        if shift is None:
            return layer
        other, more = self._judged(depth, shift, window, mask)
        return other if more > max(share, SURE_SHARE) else layer

    def _judged(
        self, depth: float, shift: tuple[float, float], window: Window, mask: np.ndarray
    ) -> tuple[Layer | None, float]:
        """Return the layer if the object may be taken for one, and the share explained."""
        z, predicted = self._normalised(depth, window, shift)
        alike = _correlation(predicted[mask], self.live[window.box][mask])
        misfit = _misfit(z[mask]) if alike > ALIKE else 1.0
        z /= np.float32(misfit)
        explained = self._explained(z, mask)
        share = float(explained[mask].mean())
        enough = share > MIN_SHARE and _largest(explained) >= MIN_CORE * self.live.size
        if not enough or (share <= SURE_SHARE and alike <= MIN_CORRELATION):
            return None, share
        return self._layer(
            z, mask, window, Layer(_NOTHING, _NOTHING.mask, depth, share, shift, misfit)
        ), share

    def _shift(
        self, depth: float, window: Window, mask: np.ndarray, limit: float
    ) -> tuple[float, float] | None:
        """
        Return how far the object lies from where `depth` puts it (ECC), None beyond `limit` px.

        Translation and tilt look alike on the ground alone, so t / d may be off by a little.
        """
        predicted, _ = self.render(depth, window, NO_SHIFT)
        warp = np.eye(2, 3, dtype=np.float32)
        try:
            match, warp = cv2.findTransformECC(
                self.live[window.box], predicted, warp, cv2.MOTION_TRANSLATION, SHIFT_STOP,
                mask.astype(np.uint8), 5,
            )  # fmt: skip
        except cv2.error:  # it does not converge where nothing matches
            return None
        x, y = float(warp[0, 2]), float(warp[1, 2])
        return (x, y) if match > MIN_CORRELATION and np.hypot(x, y) < limit else None

    def belongs(self, blob: Blob, layer: Layer) -> Layer | None:
        """Return `blob` as a piece of a layer found next to it, None when it is none."""
        window, mask = self._windowed(blob)
        if not _touch(window, _padded(layer.blob, self.live.shape)):
            return None
        z, _ = self._normalised(layer.relative_depth, window, layer.shift)
        z /= np.float32(layer.misfit)
        share = float(self._explained(z, mask)[mask].mean())
        if share <= SURE_SHARE:
            return None
        return self._layer(z, mask, window, replace(layer, share=share))

    def _windowed(self, blob: Blob) -> tuple[Window, np.ndarray]:
        """Return the window around a blob and the blob's mask in it."""
        window = _padded(blob, self.live.shape)
        mask = np.zeros((window.bottom - window.top, window.right - window.left), bool)
        top, left = blob.y - window.top, blob.x - window.left
        mask[top : top + blob.mask.shape[0], left : left + blob.mask.shape[1]] = blob.mask
        return window, mask

    @staticmethod
    def _explained(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
        explained = ((evidence(z) < EXPLAINED) & mask).astype(np.uint8)
        return cv2.morphologyEx(explained, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))

    def _layer(self, z: np.ndarray, mask: np.ndarray, window: Window, like: Layer) -> Layer:
        """Return a layer like another, of the part of a window's mask that it explains."""
        # what sticks out at the object's own depth may be a change on or beside it
        left_over = hysteresis(evidence(np.where(mask, z, np.float32(0.0))), self.change) > 0
        own = mask & ~left_over
        # the object shows in the residual twice: where it is, and where it is expected without
        # parallax. What has no counterpart there is ground that it uncovers, or may be
        blob = Blob(mask, window.left, window.top)
        x, y = self._displacement(blob, like.relative_depth)
        counterpart = cv2.warpAffine(
            mask.astype(np.float32),
            np.array([[1.0, 0.0, x], [0.0, 1.0, y]]),
            mask.shape[::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        return replace(
            like, blob=Blob(own, window.left, window.top), sure=own & (counterpart > 0.5)
        )

    def _best_depth(
        self, window: Window, mask: np.ndarray, depths: np.ndarray
    ) -> tuple[float, float]:
        """Coarse-to-fine minimum of the truncated energy over the relative depth."""
        energies = [self._energy(depth, window, mask) for depth in depths]
        best = int(np.argmin(energies))
        depth, energy = float(depths[best]), energies[best]
        for step in FINE_STEPS:
            for candidate in (depth - step, depth + step):
                value = self._energy(candidate, window, mask)
                if value < energy:
                    depth, energy = candidate, value
        return depth, energy

    def _energy(self, depth: float, window: Window, mask: np.ndarray) -> float:
        z, _ = self._normalised(depth, window)
        return float(np.minimum(z[mask] ** 2, MAX_Z2).mean())

    def _normalised(
        self, depth: float, window: Window, shift: tuple[float, float] = NO_SHIFT
    ) -> tuple[np.ndarray, np.ndarray]:
        predicted, complete = self.render(depth, window, shift)
        z = (self.live[window.box] - predicted) / self.sigma(predicted)
        z[~complete] = UNSEEN_Z
        return z, predicted

    def _parallax(self, blob: Blob, depth: float) -> float:
        """Pixels that `depth` moves the object's middle row against the background."""
        return float(np.hypot(*self._displacement(blob, depth)))

    def _displacement(self, blob: Blob, depth: float) -> tuple[float, float]:
        """From where an object is to where it were at the background's depth: x, y [px]."""
        height, width = blob.mask.shape
        times = self.path.row_times[[blob.y + height // 2]]
        shift = self.path.coordinates(times)[0, :2]
        x = blob.x + width / 2 - self.path.grid.center[0]
        y = blob.y + height / 2 - self.path.grid.center[1]
        zoom = self.path.coordinates(times)[0, 3] / self.path.grid.half_width
        far = 1.0 / depth - 1.0
        return float(far * (shift[0] + zoom * x)), float(far * (shift[1] + zoom * y))


@dataclass(frozen=True)
class Front:
    """What hides the background at one depth."""

    relative_depth: float
    shift: tuple[float, float]  # [px]
    misfit: float  # see `Layer`
    window: Window  # the two masks' part of the live frame
    inside: np.ndarray  # bool, surely covered during the whole exposure
    edge: np.ndarray  # bool, perhaps covered, or uncovered: cannot be judged


def fronts(layers: Sequence[Layer], path: CameraPath, executor: Executor) -> list[Front]:
    """Find where static objects hide the background of a live frame, farthest first."""
    places = sorted({(layer.relative_depth, layer.shift) for layer in layers}, reverse=True)
    return [
        _front(
            [layer for layer in layers if (layer.relative_depth, layer.shift) == place],
            path,
            executor,
        )
        for place in places
    ]


def _front(pieces: list[Layer], path: CameraPath, executor: Executor) -> Front:
    """Render where pieces at one depth surely and perhaps are."""
    depth, shift = pieces[0].relative_depth, pieces[0].shift
    own_path = shifted(path, depth, shift)
    cover = half_pixel(_cover_in_reference(pieces, own_path))
    parallax = np.abs(path.row_centroids()[:, :2]).max() * abs(1.0 / depth - 1.0)
    window = _around(pieces, path.grid.live_shape, math.ceil(parallax) + _gaps(path) + EDGE)
    own, _ = blurred(cover, own_path, executor, depth, window)
    uncovered, _ = blurred(cover, path, executor, 1.0, window)
    inside = own > 1.0 - RIM / 2
    edge = ((own > RIM / 2) | (uncovered > RIM / 2)) & ~inside
    misfit = max(piece.misfit for piece in pieces)
    return Front(depth, shift, misfit, window, inside, edge)


def _gaps(path: CameraPath) -> int:
    return max(3, round(GAP * path.grid.reference_shape[1]))


def _cover_in_reference(pieces: list[Layer], path: CameraPath) -> np.ndarray:
    """1 where a layer surely lies in the reference, 1/2 where it may (rows, cols) float32."""
    rows, cols = path.grid.reference_shape
    cover = np.zeros((2, rows, cols), np.uint8)  # sure, perhaps
    for layer in pieces:
        for part, mask in zip(cover, (layer.sure, layer.blob.mask), strict=True):
            for u, v in _reference_places(layer, mask, path):
                inside = (u >= 0) & (v >= 0) & (u < cols) & (v < rows)
                part[v[inside], u[inside]] = 1
    outline = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (EDGE, EDGE))
    sure = cv2.erode(_without_gaps(cover[0], path), outline)
    perhaps = cv2.dilate(_without_gaps(cover[1], path), outline)
    return (sure.astype(np.float32) + perhaps) / np.float32(2.0)


def _without_gaps(cover: np.ndarray, path: CameraPath) -> np.ndarray:
    """Close the gaps in an object's cover (rows, cols) uint8 0/1."""
    gaps = _gaps(path)
    cover = cv2.copyMakeBorder(cover, *[gaps] * 4, cv2.BORDER_CONSTANT, value=0)
    cover = cv2.morphologyEx(cover, cv2.MORPH_CLOSE, np.ones((gaps, gaps), np.uint8))
    return cover[gaps:-gaps, gaps:-gaps]


def _reference_places(
    layer: Layer, mask: np.ndarray, path: CameraPath
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield reference columns and rows of a part of the layer, one live row at a time."""
    center = path.grid.center
    homographies = path.row_homographies(layer.relative_depth)
    for row in range(mask.shape[0]):
        x = np.flatnonzero(mask[row]) + layer.blob.x
        y = row + layer.blob.y
        if y >= len(homographies) or not len(x):
            continue
        points = np.stack([x - center[0], np.full(len(x), y - center[1]), np.ones(len(x))])
        u, v, w = homographies[y] @ points
        yield (
            np.rint(u / w + center[2]).astype(np.int64),
            np.rint(v / w + center[3]).astype(np.int64),
        )


def _padded(blob: Blob, shape: tuple[int, ...], pad: int = PAD) -> Window:
    height, width = blob.mask.shape
    return Window(
        max(0, blob.y - pad),
        min(shape[0], blob.y + height + pad),
        max(0, blob.x - pad),
        min(shape[1], blob.x + width + pad),
    )


def _around(pieces: Sequence[Layer], shape: tuple[int, ...], pad: int) -> Window:
    """Smallest window with `pad` px around all pieces."""
    windows = [_padded(piece.blob, shape, pad) for piece in pieces]
    return Window(
        min(window.top for window in windows),
        max(window.bottom for window in windows),
        min(window.left for window in windows),
        max(window.right for window in windows),
    )


def _touch(a: Window, b: Window) -> bool:
    return a.top <= b.bottom and b.top <= a.bottom and a.left <= b.right and b.left <= a.right


def _largest(mask: np.ndarray) -> int:
    """Area of the largest connected region of a mask [px]."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return int(stats[1:, cv2.CC_STAT_AREA].max()) if count > 1 else 0


def _misfit(z: np.ndarray) -> float:
    """How much larger normalised residuals are than noise, 1 to MAX_MISFIT."""
    return float(np.clip(1.4826 * np.median(np.abs(z)), 1.0, MAX_MISFIT))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if a.std() < 1e-3 or b.std() < 1e-3:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
