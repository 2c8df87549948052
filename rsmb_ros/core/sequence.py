"""Synthetic flights: a reference and live frames with truth, over a drawn or a given scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from .camera import Camera
from .flight import Hover
from .motion import Grid
from .scenes import aerial_scene, pasted_object
from .shutter import ShutterTiming
from .synthesis import Nuisances, Scene, Sheet, Truth, live_frame, reference_image

LINE_DELAY = 6e-5  # s; a 480-row frame is read in 29 ms
USUAL = Nuisances(gain=1.1, vignetting=0.1, noise_electrons=8000, read_noise=0.3, jpeg_quality=90)


@dataclass(frozen=True)
class FlightPlan:
    """What is flown and how."""

    frames: int  # live frames
    rate: float  # live frames per second [Hz]
    offset_px: float  # distance of the live frames from the reference [px]
    blur_px: float  # motion blur of a row [px]
    exposure_rows: float  # t_e / t_d [rows]
    objects: int  # new objects; they appear one after the other, in a single frame all at once
    nuisances: Nuisances
    seed: int


@dataclass(frozen=True)
class SyntheticFrame:
    """One live frame and what is true of it."""

    index: int
    time: float  # since the reference [s]
    live: np.ndarray  # uint8, as the reference
    truth: Truth


class SyntheticFlight:
    """
    A flight over one scene; equal plans give equal pixels.

    Parameters
    ----------
    plan : FlightPlan
        What is flown and how.
    shape : tuple of int
        Rows and columns of the drawn scene's reference [px]; unused with a background.
    background : ndarray, optional
        (M, N) or (M, N, 3) uint8 to fly over: the reference is this image, unaltered.

    """

    def __init__(
        self, plan: FlightPlan, shape: tuple[int, int], background: np.ndarray | None = None
    ) -> None:
        self.plan = plan
        self._rng = np.random.default_rng(plan.seed)
        margin = int(np.ceil(plan.offset_px + 10 * plan.blur_px + 40))
        if background is None:
            drawn = aerial_scene(shape, self._rng, margin)
            self._scene, known = drawn.scene, drawn.objects
            self.reference = reference_image(self._scene, plan.nuisances, self._rng)
        else:
            self._scene, known = _photo_scene(background, margin), ()
            self.reference = background
        pasted = (
            replace(pasted_object(self._scene.shape, self._rng), name=f'object {n + 1}')
            for n in range(len(known), plan.objects)
        )
        self._objects: tuple[Sheet, ...] = (*known, *pasted)[: plan.objects]
        rows, cols = self._scene.shape
        self.camera = Camera.guess(cols)
        self._grid = Grid((rows, cols), (rows, cols), self.camera.focal_px)

    def frames(self) -> Iterator[SyntheticFrame]:
        """Yield the live frames in order."""
        plan = self.plan
        phase = self._rng.uniform(0, 2 * np.pi)
        hover = Hover(plan.offset_px, plan.blur_px, plan.exposure_rows, LINE_DELAY, phase)
        for index in range(plan.frames):
            time = (index + 1) / plan.rate
            live, truth = live_frame(
                self._scene,
                self._present(index),
                self._grid,
                partial(hover.poses, time),
                ShutterTiming(plan.exposure_rows),
                plan.nuisances,
                self._rng,
            )
            yield SyntheticFrame(index, time, live, truth)

    def _present(self, index: int) -> tuple[Sheet, ...]:
        """Objects in frame `index`: none at first, then one more at equal steps."""
        if self.plan.frames == 1:
            return self._objects
        step = self.plan.frames / (len(self._objects) + 2)
        return self._objects[: int(index / step)]


def _photo_scene(photo: np.ndarray, margin: int) -> Scene:
    """Return a scene whose reference is `photo`; beyond its edges it is mirrored."""
    margin = min(margin, min(photo.shape[:2]) - 1)
    return Scene(cv2.copyMakeBorder(photo, *[margin] * 4, cv2.BORDER_REFLECT_101), margin)
