"""Live frames of a reference whose depth is known: all layers registered and rendered at once."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from .composite import Composition
from .depth_map import EDGE_STEP
from .frame import PathFrame
from .path_stage import PathStage
from .reference import Box
from .render import Shown, Window, at_places, shown_at, whole
from .sampling import colour_of

KNOWN = 0.98  # share of a pixel's exposure that the reference must know for it to be judged


class LayeredFrame(PathFrame):
    """
    A live frame registered by one camera path to layers at known depths (Eq. 5).

    What the reference cannot know, behind a nearer layer or of unknown depth, is not judged.
    """

    @cached_property
    def _scene(self) -> Composition:
        assert self._reference.depth is not None
        return Composition(self._reference.depth, self.path, self._executor)

    def predict(self) -> Shown:
        """Show the whole live frame as the reference knows it, in grey."""
        seen = self._scene.render(self._fine)
        self._known = seen.known
        complete = (seen.sure > KNOWN) & ~self._scene.unknown()
        image = self._light.apply(seen.image, self._reference.gamma)
        return self._in_tones(Shown(image, None, complete))

    def light_seen(self, fine: np.ndarray) -> np.ndarray:
        """Return what of a reference's light (2M, 2N), half pixels, falls on each pixel (M, N)."""
        return self._scene.render(fine).image

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference, 0 where something hides it."""
        depth = self._reference.depth
        assert depth is not None
        places = shown_at(self.path, self._executor, depth.surface)
        image = at_places(self.live, places, cv2.INTER_CUBIC)
        seen = self._scene.render(np.repeat(np.repeat(depth.surface, 2, axis=0), 2, axis=1)).image
        image[at_places(seen, places, cv2.INTER_LINEAR) > depth.surface + EDGE_STEP] = 0
        return image

    def _seen(self, fine: np.ndarray, boxes: list[Box]) -> list[tuple[Window, np.ndarray]]:
        return [(whole(self.path), self._scene.render(fine).image)]

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it, uint8."""
        shown = self._known > 0.0
        if self._reference.image.ndim == 2:
            return np.rint(self.predicted * shown).astype(np.uint8)
        fine = self._fine_colours
        planes = [self._scene.render(colour_of(fine, c)).image for c in range(fine.shape[-1])]
        image = self._light.apply(np.stack(planes, axis=-1), self._reference.gamma)
        if self._tones is not None:
            image = self._tones.of_grey(image)
        return np.rint(image * shown[..., None]).astype(np.uint8)


class LayeredStage(PathStage):
    """Registers live frames of one size to one reference of known depth."""

    frame_class = LayeredFrame
