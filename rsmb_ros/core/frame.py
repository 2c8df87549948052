"""One live frame with its camera path: everything that is rendered from the two."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from functools import cached_property, partial

import cv2
import numpy as np

from ._kernels.pixels import mark_bright
from .agreement import Likeness, agreement, sharpness
from .depth_energy import DepthEnergy, PathEnergy, RenderedEnergy, Sight
from .evidence import NoiseTable
from .layers import NO_SHIFT, Front, Fronts, Layer, within
from .lens import Seen
from .motion import CameraPath, moved_px, shifted
from .path_fit import PathFit, row_uncertainty
from .reference import CLIPPED, Box, Reference
from .render import Shown, Window, blurred, rectified, shown
from .tone_match import ToneMatch, tone_match
from .workers import Workers, beside, each

BORDER = 5  # px next to the reference's edge that are not judged: interpolation ends there
MAX_RESIDUAL = 30.0  # grey levels; beyond that a pixel shows something else
CLIPPED_STEP = 3.0  # px between instants where only the place of clipped parts matters
CLIPPED_SHARE = 0.03  # of the exposure, from which on clipped parts of the reference matter


class RegisteredFrame(ABC):
    """
    A live frame, its prediction from the reference, and where the two can be compared.

    Parameters
    ----------
    reference : Reference
    live : ndarray of shape (M, N) or (M, N, 3), uint8
    grey : ndarray of shape (M, N), float32
        Grey levels of `live`.
    executor : Workers
        Threads that share the rendering.

    """

    def __init__(
        self, reference: Reference, live: np.ndarray, grey: np.ndarray, executor: Workers
    ) -> None:
        self.live = live
        self.grey = grey
        self._reference = reference
        self._executor = executor
        self._fronts: list[Front] = []  # farthest first
        self._in_front: dict[Front, Shown] = {}
        self._compare(self.predict())

    def _compare(self, shown: Shown) -> None:
        """Compare the live frame with what the reference shows."""
        self._ground = shown
        self.predicted, self._colours, self.complete = shown
        waited = beside(self._executor, partial(_inner, shown.complete))
        self.residual = self.grey - self.predicted
        self.misfit = np.ones(self.grey.shape, np.float32)
        self.judged = ~self._clipped()
        self.judged &= waited()

    def doubt(self, factors: np.ndarray) -> None:
        """Judge no rows whose place is infinitely less certain than it was: `factors` (M,)."""
        self.judged[np.isinf(factors)] = False

    def moved(self, path: CameraPath) -> float:
        """Return how far another path puts the rows that show some of the reference, at most."""
        return moved_px(self.path, path, self.complete.any(axis=1))

    @cached_property
    def likeness(self) -> Likeness:
        """How alike the frame and its prediction are, at the first time of asking."""
        found = agreement(self.predicted, self.grey, self.complete)
        alike = found.within(self.judged)
        return Likeness(found, sharpness(self.predicted, self.grey, alike))

    @property
    def cost(self) -> float:
        """Mean truncated residual where the frame is judged [grey levels]; compares starts."""
        known = np.abs(self.residual[self.judged])
        return float(np.minimum(known, MAX_RESIDUAL).mean()) if known.size else np.inf

    @property
    @abstractmethod
    def path(self) -> CameraPath:
        """Motion of the camera."""

    @property
    @abstractmethod
    def row_motion(self) -> np.ndarray:
        """Centroid pose tau_c of each row (M, 6)."""

    @property
    @abstractmethod
    def row_uncertainty(self) -> np.ndarray:
        """Standard deviation of each row's place (M,) [px], NaN where it is not known."""

    @property
    @abstractmethod
    def exposure_rows(self) -> float:
        """Exposure in line delays, NaN where the method has none [rows]."""

    @property
    @abstractmethod
    def gain(self) -> float:
        """Light of the live frame over that of the reference, at the image centre."""

    @abstractmethod
    def render(self, depth: float, window: Window, shift: tuple[float, float] = NO_SHIFT) -> Shown:
        """Show a layer at relative depth `depth`, moved by `shift` x, y [px]."""

    def ground(self, window: Window) -> Shown:
        """Show the background without anything in front of it; not to be written to."""
        grey, colours, complete = self._ground
        box = window.box
        return Shown(grey[box], None if colours is None else colours[box], complete[box])

    def predict(self) -> Shown:
        """Show the whole live frame as the reference knows it."""
        return self.render(1.0, Window(0, self.grey.shape[0], 0, self.grey.shape[1]))

    def match_tones(self) -> None:  # noqa: B027 - a method may know no tones
        """Show the reference in the tones of the live frame, before anything is put in front."""

    @property
    def colours(self) -> np.ndarray | None:
        """Prediction in BGR (M, N, 3) uint8; None where one of the images is grey."""
        known = self._colours is not None and self._colours.ndim == 3
        return self._colours if known and self.live.ndim == 3 else None

    def energy(self, noise: NoiseTable) -> DepthEnergy:
        """Return what compares depths at which objects of this frame may lie."""
        return RenderedEnergy(self.grey, noise, self.render)

    @abstractmethod
    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8."""

    def _clipped(self) -> np.ndarray:
        """
        Where one of the images is at its limit and what is beyond may explain the other (M, N).

        A clipped reference is a lower bound of the light, a clipped live frame a lower bound too.
        """
        unknown = np.empty(self.grey.shape, bool)
        channels = self.live.shape[2] if self.live.ndim == 3 else 1
        mark_bright(self.live.ravel(), channels, CLIPPED, self.residual.ravel(), unknown.ravel())
        if self._reference.fine_clipped is not None:
            shares = self._seen(self._reference.fine_clipped, self._reference.clipped_boxes)
            for window, share in shares:
                unknown[window.box] |= (share > CLIPPED_SHARE) & (self.residual[window.box] > 0)
        return unknown

    def _seen(self, fine: np.ndarray, boxes: list[Box]) -> list[tuple[Window, np.ndarray]]:
        """Return the parts of the frame that may show boxes of the reference, and `fine` there."""
        return [
            (window, blurred(fine, self.path, self._executor, 1.0, window, CLIPPED_STEP)[0])
            for window in self._showing(boxes)
        ]

    def _showing(self, boxes: list[Box]) -> list[Window]:
        """Return the parts of the live frame that may show boxes of the reference."""
        moved = np.abs(self.path.coordinates(self.path.row_times)).max(axis=0)
        reach = int(np.ceil(moved.sum() + np.abs(np.diff(moved[:2])).sum())) + 16
        parts = [self._around(box, reach) for box in boxes]
        left, top = np.min(boxes, axis=0)[:2]
        right, bottom = np.max(boxes, axis=0)[2:]
        one = self._around((left, top, right, bottom), reach)
        return parts if sum(part.area for part in parts) < one.area else [one]

    def _around(self, box: Box, reach: int) -> Window:
        """Return the part of the live frame within `reach` of a box of the reference [px]."""
        rows, cols = self.grey.shape
        extra = (np.array([rows, cols]) - self.path.grid.reference_shape) // 2
        left, top, right, bottom = box
        return Window(
            max(0, min(rows, top - reach + extra[0])),
            max(0, min(rows, bottom + reach + extra[0])),
            max(0, min(cols, left - reach + extra[1])),
            max(0, min(cols, right + reach + extra[1])),
        )

    def foreground(self, layers: list[Layer]) -> np.ndarray:
        """Where `layers` hide the background or may do so (M, N) bool."""
        mask = np.zeros(self.grey.shape, bool)
        for front in self._hidden.of(layers):
            mask[front.window.box] |= front.inside | front.edge
        return mask

    @cached_property
    def _hidden(self) -> Fronts:
        return Fronts(self.path, self._executor)

    def put_in_front(self, layers: list[Layer]) -> None:
        """Composite static objects over the background; their edges are no longer judged."""
        self._fronts = self._hidden.of(layers)
        if self.predicted is self._ground.grey:  # which must stay as it is
            self.predicted = self.predicted.copy()
            self._colours = None if self._colours is None else self._colours.copy()
        new = [front for front in self._fronts if front not in self._in_front]
        own = each(self._executor, self._own, new, lambda front: front.edge.size)
        self._in_front.update(zip(new, own, strict=True))
        for front in self._fronts:
            box, seen = front.window.box, self._in_front[front]
            self.judged[box] &= ~front.unknown(seen.grey, seen.complete, self.predicted[box])
            inside = front.inside & seen.complete
            self.predicted[box][inside] = seen.grey[inside]
            if self._colours is not None and seen.colours is not None:
                self._colours[box][inside] = seen.colours[inside]
            self.misfit[box][inside] = front.place.misfit
        self.residual = self.grey - self.predicted

    def _own(self, front: Front) -> Shown:
        """Show a front in its window, as far as it is needed."""
        part = np.s_[:, :] if front.slight else front.core
        grey = np.zeros(front.edge.shape, np.float32)
        complete = np.zeros(front.edge.shape, bool)
        if part is None:
            return Shown(grey, None, complete)
        window = front.window if front.slight else within(front.window, part)
        own = self.render(front.place.relative_depth, window, front.place.shift)
        grey[part], complete[part] = own.grey, own.complete
        if own.colours is None:
            return Shown(grey, None, complete)
        colours = np.zeros(grey.shape + own.colours.shape[2:], np.uint8)
        colours[part] = own.colours
        return Shown(grey, colours, complete)

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference, uint8."""
        return rectified(self.live, self.path, self._executor)


class PathFrame(RegisteredFrame):
    """A live frame registered by one camera path; blurred in linear light."""

    def __init__(
        self,
        reference: Reference,
        live: np.ndarray,
        grey: np.ndarray,
        fit: PathFit,
        executor: Workers,
    ) -> None:
        self.fit = fit
        self._light = fit.light  # less what `_tones` says of it
        self._tones: ToneMatch | None = None
        super().__init__(reference, live, grey, executor)

    @property
    def path(self) -> CameraPath:
        """The fitted path."""
        return self.fit.path

    @property
    def row_motion(self) -> np.ndarray:
        """Centroid pose tau_c of each row (M, 6)."""
        return self.path.row_motion()

    @cached_property
    def row_uncertainty(self) -> np.ndarray:
        """Standard deviation of each row's place (M,) [px], from the Hessian."""
        return row_uncertainty(self.fit)

    def doubt(self, factors: np.ndarray) -> None:
        """Say that rows' places are `factors` (M,) times less certain; judge none that are lost."""
        super().doubt(factors)
        self.row_uncertainty *= factors

    @property
    def exposure_rows(self) -> float:
        """Exposure in line delays, given or self-calibrated [rows]."""
        return self.path.exposure_rows

    @property
    def gain(self) -> float:
        """Light of the live frame over that of the reference, in linear light."""
        return float(self.fit.light.gain[0])

    @cached_property
    def _seen_grey(self) -> Seen:
        return self._reference.lens.seen(self.fit.defocus, self._executor)

    @cached_property
    def _seen_colours(self) -> Seen:
        if self._reference.fine_colours is self._reference.fine:
            return self._seen_grey
        return self._reference.lens_colours.seen(self.fit.defocus, self._executor)

    @property
    def _fine(self) -> np.ndarray:
        """Half-pixel reference as sharp as the live camera's lens shows it, linear light."""
        return self._seen_grey.fine

    @property
    def _fine_colours(self) -> np.ndarray:
        """Each colour's `_fine`, see `Reference.fine_colours`."""
        return self._seen_colours.fine

    def match_tones(self) -> None:
        """Show the reference in the tones of the live frame, where they are others."""
        predicted = Shown(self.predicted, self._colours, self.complete)
        if tone_match(predicted, self.live, self.grey, self._executor) is None:
            return
        # a bias below 0 makes all dark tones one: the curve takes its part
        self._light = replace(self.fit.light, bias=0.0)
        unbiased = self.predict()
        self._tones = tone_match(unbiased, self.live, self.grey, self._executor)
        if self._tones is None:
            self._light = self.fit.light
        else:
            self._compare(self._tones.of(unbiased))

    def _in_tones(self, image: Shown) -> Shown:
        return image if self._tones is None else self._tones.of(image)

    def render(self, depth: float, window: Window, shift: tuple[float, float] = NO_SHIFT) -> Shown:
        """Show a layer in the light and tones of the live frame."""
        path = shifted(self.fit.path, depth, shift)
        gamma = self._reference.gamma
        return self._in_tones(
            shown(self._fine_colours, path, self._light, gamma, self._executor, depth, window)
        )

    def light_seen(self, fine: np.ndarray) -> np.ndarray:
        """Return what of a reference's light (2M, 2N), half pixels, falls on each pixel (M, N)."""
        return blurred(fine, self.path, self._executor)[0]

    def energy(self, noise: NoiseTable) -> DepthEnergy:
        """Return what compares depths at which objects of this frame may lie, in grey."""
        sight = Sight(self._fine, self.path, self._light, self._reference.gamma, self._tones)
        return PathEnergy(self.grey, noise, sight)

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8."""
        assert self._colours is not None
        return self._colours.copy()


def _inner(complete: np.ndarray) -> np.ndarray:
    """Where a mask (M, N) bool holds for all that is near, its border included (M, N) bool."""
    edge = cv2.copyMakeBorder(complete.view(np.uint8), *[1] * 4, cv2.BORDER_CONSTANT)
    return cv2.erode(edge, np.ones((BORDER, BORDER), np.uint8))[1:-1, 1:-1] > 0
