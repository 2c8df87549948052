"""One live frame with its camera path: everything that is rendered from the two."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from .layers import Front, Layer, fronts
from .path_estimator import PathFit
from .photometric import to_display
from .reference import Reference
from .render import Window, blurred, rectified

BORDER = 5  # px next to the reference's edge that are not judged: interpolation ends there
SATURATED = 254.0  # grey levels; both images at the limit say nothing about each other


class RegisteredFrame:
    """
    A live frame, its prediction from the reference, and where the two can be compared.

    Parameters
    ----------
    reference : Reference
    live : ndarray of shape (M, N) or (M, N, 3), uint8
    grey : ndarray of shape (M, N), float32
        Grey levels of `live`.
    fit : PathFit
        Path and light of the live frame.
    executor : Executor
        Threads that share the rendering.

    """

    def __init__(
        self,
        reference: Reference,
        live: np.ndarray,
        grey: np.ndarray,
        fit: PathFit,
        executor: Executor,
    ) -> None:
        self.fit = fit
        self.grey = grey
        self._reference = reference
        self._live = live
        self._executor = executor
        self._fronts: list[Front] = []
        self.predicted, self.complete = self.render(1.0, Window(0, grey.shape[0], 0, grey.shape[1]))
        self.residual = grey - self.predicted
        edge = cv2.copyMakeBorder(self.complete.astype(np.uint8), *[1] * 4, cv2.BORDER_CONSTANT)
        inner = cv2.erode(edge, np.ones((BORDER, BORDER), np.uint8))[1:-1, 1:-1] > 0
        self.judged = inner & ~((grey >= SATURATED) & (self.predicted >= SATURATED))

    def foreground(self, layers: list[Layer]) -> np.ndarray:
        """Where `layers` hide the background or may do so (M, N) bool."""
        mask = np.zeros(self.grey.shape, bool)
        for front in fronts(layers, self.fit.path, self._executor):
            mask[front.window.box] |= front.inside | front.edge
        return mask

    def put_in_front(self, layers: list[Layer]) -> None:
        """Composite static objects over the background; their edges are no longer judged."""
        self._fronts = fronts(layers, self.fit.path, self._executor)
        for front in self._fronts:
            own, complete = self.render(front.relative_depth, front.window)
            inside = front.inside & complete
            self.predicted[front.window.box][inside] = own[inside]
            self.judged[front.window.box] &= ~front.edge
        self.residual = self.grey - self.predicted

    @cached_property
    def _gain_field(self) -> np.ndarray:
        return self.fit.light.gain_field(self.grey.shape)

    def render(self, depth: float, window: Window) -> tuple[np.ndarray, np.ndarray]:
        """Display values a layer at `depth` would have in the live frame, and where they hold."""
        linear, complete = self._blurred(self._reference.fine, depth, window)
        light = linear * self._gain_field[window.box] + np.float32(self.fit.light.bias)
        return to_display(light, self._reference.gamma), complete

    def _blurred(
        self, fine: np.ndarray, depth: float = 1.0, window: Window | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        return blurred(fine, self.fit.path, self._executor, depth, window)

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8."""
        if self._reference.image.ndim == 2:
            image = self.predicted * self.complete
        else:
            planes = [self._composited(fine) for fine in self._reference.fine_planes]
            image = self.fit.light.apply(np.stack(planes, axis=-1), self._reference.gamma)
            image *= self.complete[..., None]
        return np.rint(image).astype(np.uint8)

    def _composited(self, fine: np.ndarray) -> np.ndarray:
        """Linear light of one plane of the reference, layers in front (M, N) float32."""
        image, _ = self._blurred(fine)
        for front in self._fronts:
            own, complete = self._blurred(fine, front.relative_depth, front.window)
            inside = front.inside & complete
            image[front.window.box][inside] = own[inside]
        return image

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference, uint8."""
        return rectified(self._live, self.fit.path, self._executor)


@dataclass(frozen=True)
class BlankViews:
    """Views of a frame that could not be registered: black."""

    reference: np.ndarray
    live: np.ndarray

    def registered(self) -> np.ndarray:
        """Return black in the live frame's size and the reference's channels."""
        return np.zeros(self.live.shape[:2] + self.reference.shape[2:], np.uint8)

    def rectified(self) -> np.ndarray:
        """Return black in the reference's size and the live frame's channels."""
        return np.zeros(self.reference.shape[:2] + self.live.shape[2:], np.uint8)
