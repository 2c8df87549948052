"""
Search for the relative depth of what the background does not explain (Algorithm 1 of the report).

Each object is rendered again with the same camera path and its translation scaled by a relative
depth; where one depth explains a large part of it, that part was in the reference all along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property

import cv2
import numpy as np

from .agreement import correlation
from .colour import tint_off
from .config import ChangeConfig, LayersConfig
from .depth_energy import BestDepth, DepthEnergy
from .evidence import NoiseTable, Texture, evidence
from .frame import RegisteredFrame
from .layers import NO_SHIFT, Layer, Place, padded
from .motion import CameraPath
from .refused import Refused
from .render import Shown, Window
from .segmentation import Blob, hysteresis

COARSE_STEP = 0.05
PAD = 6  # px around an object that is rendered with it
UNSEEN_Z = 9.0  # normalised residual of a pixel that a depth cannot show
EXPLAINED = 2.2  # evidence below which a pixel is explained [sigma]
MIN_PARALLAX = 0.4  # px; less than that and a depth must explain an object well
MIN_SHARE = 0.13  # of the object that must be explained
MIN_COVERED = 0.45  # of a mask that an object covers, below which the whole mask is asked
MIN_CORE = 4.2e-4  # of the frame: largest connected explained part (130 px at 640x480)
SAME_DEPTH = 0.02  # of a layer found near: two that found it on their own need half of that each
MIN_CORRELATION = 0.6  # of prediction and live on the object ...
SURE_SHARE = 0.5  # ... unless this share is explained, ...
PIECE_SHARE = 0.15  # ... or one piece of this share is alike: the rest may be another object
ALIKE = 0.9  # correlation of such a piece, and of an object that may fit less well than others ...
MAX_MISFIT = 2.5  # ... by so much
MAX_ENERGY_RATIO = 0.85  # of the energy at the background's depth
UNLIKE = 0.5  # correlation below which no small shift makes an object alike; where one did: .56 on
SMOOTHING = 5  # px, of what shifts are found by
MIN_DISPLACED = 0.3  # of an object that must stand out where it is displaced from or to, too
MAX_SHIFT = 0.5  # of an object's parallax: tilt and translation are not told apart better
MAX_OFF = 2.5  # px, that a static object may lie from where the background puts it
CLEAR_RATIO = 0.7  # an object that fits less well is not asked again
SHIFT_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)


@dataclass(frozen=True)
class DepthSearch:
    """Judges objects of one frame against the reference at other depths."""

    frame: RegisteredFrame
    noise: NoiseTable
    energy: DepthEnergy
    tint_limit: float | None  # levels, that colours may be off; None: grey
    marked: np.ndarray  # (M, N) bool, where the ground does not explain the frame, or is not asked
    config: LayersConfig
    change: ChangeConfig
    refused: Refused = field(default_factory=Refused)

    @property
    def live(self) -> np.ndarray:
        """Live frame (M, N) float32 [grey levels]."""
        return self.frame.grey

    @property
    def path(self) -> CameraPath:
        """Path of the camera."""
        return self.frame.path

    @cached_property
    def _row_coordinates(self) -> np.ndarray:
        """Path coordinates in the middle of each row's exposure (M, 6), see `CameraPath`."""
        return self.path.coordinates(self.path.row_times)

    def explain(self, blob: Blob, known: Sequence[Layer] = ()) -> Layer | None:
        """
        Return the layer that explains `blob`, None when it is a change.

        `known` layers come from an earlier look at the same frame: near one of them its depth
        and a little around it is tried before all others.
        """
        window, mask = self._windowed(blob)
        near = [
            layer.place.relative_depth
            for layer in known
            if _touch(window, padded(layer.blob, self.live.shape, PAD))
        ]
        reach = float(np.hypot(*self._displacement(blob)))
        beside = None
        if near:
            best = self.energy.best(window, mask, np.array(near), reach)
            beside = self._explained(best, reach, window, mask, MIN_CORE)
            if beside is not None and _fits(beside.place):
                return beside
        if (blob, self.path) in self.refused:
            return beside
        depths = np.arange(self.config.depth_min, self.config.depth_max + 1e-9, COARSE_STEP)
        best = self.energy.best(window, mask, depths, reach)
        agreed = any(_agree(best.depth, window, layer, self.live.shape) for layer in known)
        layer = self._explained(best, reach, window, mask, MIN_CORE / 2 if agreed else MIN_CORE)
        if layer is None and best.energy > CLEAR_RATIO * best.background:
            self.refused.add(blob, self.path)
        # a depth of its own goes before a neighbour's that fits with some help only
        return beside if layer is None or (beside and not _fits(layer.place)) else layer

    def _explained(
        self,
        best: BestDepth,
        reach: float,
        window: Window,
        mask: np.ndarray,
        core: float,
    ) -> Layer | None:
        """
        Return the layer that explains an object at its best depth, or not far from there.

        `core` is the share of the frame that must be explained in one piece.
        """
        depth = best.depth
        parallax = reach * abs(1.0 / depth - 1.0)
        layer, share = None, 0.0

        @cache  # what is judged at a depth is where a shift from there begins
        def shown(depth: float, shift: tuple[float, float] = NO_SHIFT) -> Shown:
            if depth == 1.0 and shift == NO_SHIFT:
                return self.frame.ground(window)
            return self.frame.render(depth, window, shift)

        if best.energy < MAX_ENERGY_RATIO * best.background:
            layer, share = self._judged(shown(depth), depth, NO_SHIFT, window, mask, core)
            if share > SURE_SHARE:
                return layer
        if parallax < MIN_PARALLAX:
            layer = None
        if layer is None:
            share = 0.0  # what may not be taken must not outdo a shift
        # tilt and translation look alike on the ground alone: then t / d points elsewhere
        starts = [(depth, 1.0 + MAX_SHIFT * parallax), (1.0, MAX_OFF)]
        if parallax < MIN_PARALLAX:
            del starts[0]  # the same as the other
        for start, limit in starts:
            shift = self._shift(shown(start), window, mask, limit)
            if shift is not None:
                own = shown(start, shift)
                other, more = self._judged(own, start, shift, window, mask, core)
                if more > max(share, SURE_SHARE):
                    layer, share = other, more
        return layer

    def _judged(
        self,
        own: Shown,
        depth: float,
        shift: tuple[float, float],
        window: Window,
        mask: np.ndarray,
        core: float,
    ) -> tuple[Layer | None, float]:
        """
        Return the layer if the object may be taken for one, and the share of it explained.

        `own` is what a window shows at `depth` and `shift`.
        """
        z = self._normalised(own, window)
        covered = self._covered(mask, window, depth)
        if np.count_nonzero(covered) < MIN_COVERED * np.count_nonzero(mask):
            covered = mask
        alike = correlation(own.grey[covered], self.live[window.box][covered])
        misfit = _misfit(z[covered]) if alike > ALIKE else 1.0
        z /= np.float32(misfit)
        explained = _explained(z, mask)
        share = float(explained[covered].mean())
        piece = _largest(explained)
        enough = share > MIN_SHARE and np.count_nonzero(piece) >= core * self.live.size
        if not enough:
            return None, share
        if share <= SURE_SHARE and alike <= MIN_CORRELATION:
            if np.count_nonzero(piece) < PIECE_SHARE * np.count_nonzero(covered):
                return None, share
            alike = correlation(own.grey[piece], self.live[window.box][piece])
            if alike < ALIKE:
                return None, share
        part = Blob(explained > 0, window.left, window.top)
        if self._other_colour(own, window, explained) or not self._displaced(
            part, depth, alike > MIN_CORRELATION
        ):
            return None, share
        return self._layer(z, mask, window, Place(depth, shift, misfit), share), share

    def _other_colour(self, own: Shown, window: Window, explained: np.ndarray) -> bool:
        """Whether what brightness explains has another colour."""
        if self.tint_limit is None or own.colours is None:
            return False
        off = tint_off(self.frame.live[window.box], own.colours, explained > 0)
        return off > self.tint_limit

    def _displaced(self, blob: Blob, depth: float, trusted: bool) -> bool:
        """
        Whether something stands out where an object came from, or went to.

        A static object does so twice, unless it is like the ground. What does so once is ground
        that shows where an object has gone: it looks like other ground, at any depth. Beyond the
        frame only what is `trusted`, because it has texture of its own, may come from or go to.
        """
        rows, cols = self.marked.shape
        y, x = np.nonzero(blob.mask)
        far = 1.0 / depth - 1.0
        to_x, to_y = (far * part for part in self._displacement(blob))
        for sign in (1.0, -1.0):
            u = np.rint(x + blob.x + sign * to_x).astype(np.int64)
            v = np.rint(y + blob.y + sign * to_y).astype(np.int64)
            inside = (u >= 0) & (v >= 0) & (u < cols) & (v < rows)
            shown = int(np.count_nonzero(self.marked[v[inside], u[inside]]))
            beyond = int(np.count_nonzero(~inside)) if trusted else 0
            if shown + beyond > MIN_DISPLACED * len(x):
                return True
        return False

    def _shift(
        self, own: Shown, window: Window, mask: np.ndarray, limit: float
    ) -> tuple[float, float] | None:
        """
        Return how far the object lies from where a depth, that shows `own`, puts it, by ECC [px].

        None where that does not converge, or beyond `limit` px.
        """
        predicted, live = own.grey, self.live[window.box]
        smooth = [cv2.GaussianBlur(image, (SMOOTHING,) * 2, 0)[mask] for image in (predicted, live)]
        if correlation(*smooth) < UNLIKE:
            return None
        warp = np.eye(2, 3, dtype=np.float32)
        try:
            match, warp = cv2.findTransformECC(
                live, predicted, warp, cv2.MOTION_TRANSLATION, SHIFT_STOP, mask.astype(np.uint8),
                SMOOTHING,
            )  # fmt: skip
        except cv2.error:  # it does not converge where nothing matches
            return None
        x, y = float(warp[0, 2]), float(warp[1, 2])
        return (x, y) if match > MIN_CORRELATION and np.hypot(x, y) < limit else None

    def belongs(self, blob: Blob, layer: Layer) -> Layer | None:
        """Return `blob` as a piece of a layer found next to it, None when it is none."""
        if not _touch(*(padded(one, self.live.shape, PAD) for one in (blob, layer.blob))):
            return None
        window, mask = self._windowed(blob)
        own = self.frame.render(layer.place.relative_depth, window, layer.place.shift)
        z = self._normalised(own, window)
        z /= np.float32(layer.place.misfit)
        share = float(_explained(z, mask)[mask].mean())
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

    def _layer(
        self, z: np.ndarray, mask: np.ndarray, window: Window, place: Place, share: float
    ) -> Layer:
        """Return the part of a window's mask that a place explains."""
        # what sticks out at the object's own depth may be a change on or beside it
        left_over = hysteresis(evidence(np.where(mask, z, np.float32(0.0))), self.change) > 0
        own = mask & ~left_over
        sure = own & self._covered(mask, window, place.relative_depth)
        return Layer(Blob(own, window.left, window.top), sure, place, share)

    def _covered(self, mask: np.ndarray, window: Window, depth: float) -> np.ndarray:
        """
        Return what of a window's mask an object at some depth covers itself.

        It shows in the residual twice: where it is, and where it is expected without parallax. What
        has no counterpart there is ground that it uncovers, or may be: no depth explains that.
        """
        far = 1.0 / depth - 1.0
        x, y = (far * part for part in self._displacement(Blob(mask, window.left, window.top)))
        move = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        counterpart = cv2.warpAffine(mask.astype(np.float32), move, mask.shape[::-1], flags=flags)
        return mask & (counterpart > 0.5)

    def _normalised(self, own: Shown, window: Window) -> np.ndarray:
        """Return the normalised residual of a window, of which `own` is shown."""
        z = (self.live[window.box] - own.grey) / self.noise(Texture.of(own.grey))
        z[~own.complete] = UNSEEN_Z
        return z

    def _displacement(self, blob: Blob) -> tuple[float, float]:
        """How far 1 in 1/d moves the middle of an object: x, y [px]."""
        height, width = blob.mask.shape
        q = self._row_coordinates[blob.y + height // 2]
        x = blob.x + width / 2 - self.path.grid.center[0]
        y = blob.y + height / 2 - self.path.grid.center[1]
        zoom = q[3] / self.path.grid.half_width
        return float(q[0] + zoom * x), float(q[1] + zoom * y)


def _explained(z: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Where a place explains an object, uint8 0/1."""
    explained = ((evidence(z) < EXPLAINED) & mask).astype(np.uint8)
    return cv2.morphologyEx(explained, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))


def _fits(place: Place) -> bool:
    """Whether an object lies where its depth puts it, not just near there."""
    return place.shift == NO_SHIFT and place.misfit < MAX_MISFIT


def _agree(depth: float, window: Window, layer: Layer, shape: tuple[int, int]) -> bool:
    """Whether a depth is that of a layer found no further away than half its size."""
    around = padded(layer.blob, shape, max(layer.blob.mask.shape) // 2)
    return abs(layer.place.relative_depth - depth) < SAME_DEPTH and _touch(window, around)


def _touch(a: Window, b: Window) -> bool:
    return a.top <= b.bottom and b.top <= a.bottom and a.left <= b.right and b.left <= a.right


def _largest(mask: np.ndarray) -> np.ndarray:
    """Return the largest connected region of a mask (M, N) uint8 0/1, (M, N) bool."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count < 2:
        return mask > 0
    return labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()


def _misfit(z: np.ndarray) -> float:
    """How much larger normalised residuals are than noise, 1 to MAX_MISFIT."""
    return float(np.clip(1.4826 * np.median(np.abs(z)), 1.0, MAX_MISFIT))
