"""
Search for the relative depth of what the background does not explain (Algorithm 1 of the report).

Each object is rendered again with the same camera path and its translation scaled by a relative
depth; where one depth explains a large part of it, that part was in the reference all along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .config import ChangeConfig, LayersConfig
from .evidence import NoiseTable, Texture, evidence
from .layers import NO_SHIFT, Layer, Place, padded
from .motion import CameraPath
from .render import Window
from .segmentation import Blob, hysteresis

COARSE_STEP = 0.05
FINE_STEPS = (0.025, 0.0125, 0.006, 0.003, 0.0015)
PAD = 6  # px around an object that is rendered with it
UNSEEN_Z = 9.0  # normalised residual of a pixel that a depth cannot show
MAX_Z2 = 16.0  # truncation of the energy that depths are compared by
EXPLAINED = 2.2  # evidence below which a pixel is explained [sigma]
MIN_PARALLAX = 0.4  # px; less than that and a depth must explain an object well
MIN_SHARE = 0.13  # of the object that must be explained
MIN_CORE = 4.2e-4  # of the frame: largest connected explained part (130 px at 640x480)
MIN_CORRELATION = 0.6  # of prediction and live on the object ...
SURE_SHARE = 0.5  # ... unless this share is explained
ALIKE = 0.9  # correlation of an object that may fit less well than its surroundings ...
MAX_MISFIT = 2.5  # ... by so much
MAX_ENERGY_RATIO = 0.85  # of the energy at the background's depth
MAX_SHIFT = 0.5  # of an object's parallax: tilt and translation are not told apart better
MAX_OFF = 2.5  # px, that a static object may lie from where the background puts it
SHIFT_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)

# (depth, window, shift) -> predicted display values, where they hold
Render = Callable[[float, Window, tuple[float, float]], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class DepthSearch:
    """Judges objects of one frame against the reference at other depths."""

    live: np.ndarray  # (M, N) float32 display values
    noise: NoiseTable
    render: Render
    sketch: Render  # the same in grey: quick, and good enough to compare depths by
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
        near = [
            layer for layer in known if _touch(window, padded(layer.blob, self.live.shape, PAD))
        ]
        if near:
            depths = np.array([layer.place.relative_depth for layer in near])
            beside = self._explained_at(depths, blob, window, mask)
            if beside is not None and _fits(beside.place):
                return beside
        else:
            beside = None
        depths = np.arange(self.config.depth_min, self.config.depth_max + 1e-9, COARSE_STEP)
        layer = self._explained_at(depths, blob, window, mask)
        # a depth of its own goes before a neighbour's that fits with some help only
        return beside if layer is None or (beside and not _fits(layer.place)) else layer

    def _explained_at(
        self, depths: np.ndarray, blob: Blob, window: Window, mask: np.ndarray
    ) -> Layer | None:
        """Return the layer that explains `blob` near one of these depths."""
        depth, energy = self._best_depth(window, mask, depths)
        parallax = self._parallax(blob, depth)
        layer, share = self._judged(depth, NO_SHIFT, window, mask)
        if energy >= MAX_ENERGY_RATIO * self._energy(1.0, window, mask):
            layer = None
        elif share > SURE_SHARE:
            return layer
        if parallax < MIN_PARALLAX:
            layer = None
        if layer is None:
            share = 0.0  # what may not be taken must not outdo a shift
        # tilt and translation look alike on the ground alone: then t / d points elsewhere
        for start, limit in ((depth, 1.0 + MAX_SHIFT * parallax), (1.0, MAX_OFF)):
            shift = self._shift(start, window, mask, limit)
            if shift is not None:
                other, more = self._judged(start, shift, window, mask)
                if more > max(share, SURE_SHARE):
                    layer, share = other, more
        return layer

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
        return self._layer(z, mask, window, Place(depth, shift, misfit), share), share

    def _shift(
        self, depth: float, window: Window, mask: np.ndarray, limit: float
    ) -> tuple[float, float] | None:
        """
        Return how far the object lies from where `depth` puts it, by ECC [px].

        None where that does not converge, or beyond `limit` px.
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
        if not _touch(window, padded(layer.blob, self.live.shape, PAD)):
            return None
        z, _ = self._normalised(layer.place.relative_depth, window, layer.place.shift)
        z /= np.float32(layer.place.misfit)
        share = float(self._explained(z, mask)[mask].mean())
        if share <= SURE_SHARE:
            return None
        return self._layer(z, mask, window, layer.place, share)

    def _windowed(self, blob: Blob) -> tuple[Window, np.ndarray]:
        """Return the window around a blob and the blob's mask in it."""
        window = padded(blob, self.live.shape, PAD)
        mask = np.zeros((window.bottom - window.top, window.right - window.left), bool)
        top, left = blob.y - window.top, blob.x - window.left
        mask[top : top + blob.mask.shape[0], left : left + blob.mask.shape[1]] = blob.mask
        return window, mask

    @staticmethod
    def _explained(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
        explained = ((evidence(z) < EXPLAINED) & mask).astype(np.uint8)
        return cv2.morphologyEx(explained, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))

    def _layer(
        self, z: np.ndarray, mask: np.ndarray, window: Window, place: Place, share: float
    ) -> Layer:
        """Return the part of a window's mask that a place explains."""
        # what sticks out at the object's own depth may be a change on or beside it
        left_over = hysteresis(evidence(np.where(mask, z, np.float32(0.0))), self.change) > 0
        own = mask & ~left_over
        # the object shows in the residual twice: where it is, and where it is expected without
        # parallax. What has no counterpart there is ground that it uncovers, or may be
        blob = Blob(mask, window.left, window.top)
        x, y = self._displacement(blob, place.relative_depth)
        counterpart = cv2.warpAffine(
            mask.astype(np.float32),
            np.array([[1.0, 0.0, x], [0.0, 1.0, y]]),
            mask.shape[::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        sure = own & (counterpart > 0.5)
        return Layer(Blob(own, window.left, window.top), sure, place, share)

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
        predicted, complete = self.sketch(depth, window, NO_SHIFT)
        z = self._misfit_of(predicted, complete, window)
        return float(np.minimum(z[mask] ** 2, MAX_Z2).mean())

    def _normalised(
        self, depth: float, window: Window, shift: tuple[float, float] = NO_SHIFT
    ) -> tuple[np.ndarray, np.ndarray]:
        predicted, complete = self.render(depth, window, shift)
        return self._misfit_of(predicted, complete, window), predicted

    def _misfit_of(self, predicted: np.ndarray, complete: np.ndarray, window: Window) -> np.ndarray:
        """Return the normalised residual of a window's prediction."""
        z = (self.live[window.box] - predicted) / self.noise(Texture.of(predicted))
        z[~complete] = UNSEEN_Z
        return z

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


def _fits(place: Place) -> bool:
    """Whether an object lies where its depth puts it, not just near there."""
    return place.shift == NO_SHIFT and place.misfit < MAX_MISFIT


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
