"""Synthetic flights: a reference and live frames with truth, over a drawn or a given ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming

from .aerial import BASE_PIXELS, SUBURB, Style, aerial_scene, free_place
from .exposure import Path
from .frame import Truth, live_frame, reference_image
from .objects import any_object, appearing, cast_shadow, enlarged
from .paths import POSE_ZERO, SIX_DOF, Hover, blurred_by, offset, wobble
from .scene import GONE, Scene, Sheet
from .sensor import Nuisances

HOVER = 'hover'  # a circular shake, the same in every frame
LINE_DELAY = 6e-5  # s; a 480-row frame is read in 29 ms
MIN_CONTRAST = 18.0  # grey levels of one colour an object differs from the ground it lies on


@dataclass(frozen=True)
class FlightPlan:
    """What is flown and how."""

    frames: int  # live frames
    rate: float  # live frames per second [Hz]
    offset_px: float  # distance of the live frames from the reference [px]
    blur_px: float  # motion blur of a row [px]
    timing: ShutterTiming
    objects: int  # new objects; they appear one after the other, in a single frame all at once
    nuisances: Nuisances
    seed: int
    shadows: float = 0.0  # light the objects' shadows take, 0..1
    vanished: int = 0  # further objects that are in the reference only
    motion: str = HOVER  # of the rows: HOVER or one of `paths.MOTIONS`
    style: Style = SUBURB  # of the drawn scene
    focal_px: float = 0.0  # [px], 0: that of a usual lens


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
        (M, N) or (M, N, 3) uint8 to fly over: the reference is this image, unaltered unless
        something vanishes from it.

    """

    def __init__(
        self, plan: FlightPlan, shape: tuple[int, int], background: np.ndarray | None = None
    ) -> None:
        self.plan = plan
        self._rng = np.random.default_rng(plan.seed)
        margin = int(np.ceil(plan.offset_px + 10 * plan.blur_px + 40))
        if background is None:
            self._scene = aerial_scene(shape, self._rng, margin, plan.style)
        else:
            self._scene = _photo_scene(background, margin)
        placed = placed_objects(self._scene, plan.objects + plan.vanished, self._rng)
        self._objects = placed[: plan.objects]
        self._gone = tuple(replace(sheet, kind=GONE) for sheet in placed[plan.objects :])
        if background is None or self._gone:
            self.reference = reference_image(
                self._scene, plan.nuisances, self._rng, with_shadows(self._gone, plan.shadows)
            )
        else:
            self.reference = background
        rows, cols = self._scene.shape
        self.camera = Camera(plan.focal_px) if plan.focal_px else Camera.guess(cols)
        self._grid = Grid((rows, cols), (rows, cols), self.camera.focal_px)

    def frames(self) -> Iterator[SyntheticFrame]:
        """Yield the live frames in order."""
        plan = self.plan
        phase = self._rng.uniform(0, 2 * np.pi)
        shake = plan.blur_px if plan.motion == HOVER else 0.0
        hover = Hover(plan.offset_px, shake, plan.timing.exposure_rows, LINE_DELAY, phase)
        for index in range(plan.frames):
            time = (index + 1) / plan.rate
            live, truth = live_frame(
                self._scene,
                with_shadows((*self._gone, *self._present(index)), plan.shadows),
                self._grid,
                self._path(partial(hover.poses, time)),
                plan.timing,
                plan.nuisances,
                self._rng,
            )
            yield SyntheticFrame(index, time, live, truth)

    def _path(self, hover: Path) -> Path:
        """Add the motion of the rows to the drone's own."""
        plan, rows = self.plan, self._grid.live_shape[0]
        if plan.motion == HOVER:
            return hover
        part = wobble(plan.motion, SIX_DOF, plan.timing, rows, self._rng)
        return offset(POSE_ZERO, hover, blurred_by(part, plan.blur_px, plan.timing, rows))

    def _present(self, index: int) -> tuple[Sheet, ...]:
        """Objects in frame `index`: none at first, then one more at equal steps."""
        if self.plan.frames == 1:
            return self._objects
        step = self.plan.frames / (len(self._objects) + 2)
        return self._objects[: int(index / step)]


def placed_objects(scene: Scene, count: int, rng: np.random.Generator) -> tuple[Sheet, ...]:
    """Lay up to `count` new objects on free ground of the reference, where they stand out."""
    taken = roofed(scene)
    zoom = max(1.0, np.sqrt(scene.shape[0] * scene.shape[1] / BASE_PIXELS))
    placed: list[Sheet] = []
    for _ in range(20 * count):
        if len(placed) == count:
            break
        name = f'object {len(placed) + 1}'
        sheet = laid(enlarged(any_object(rng), zoom), scene, taken, rng, name)
        placed += [sheet] if sheet else []
    return tuple(placed)


def roofed(scene: Scene) -> np.ndarray:
    """Mark what the layers of a scene hide in the reference (M, N) bool."""
    taken = np.zeros(scene.shape, bool)
    for layer in scene.layers:
        height, width = layer.cover.shape
        top, left = max(int(layer.y) - 10, 0), max(int(layer.x) - 10, 0)
        taken[top : int(layer.y) + height + 10, left : int(layer.x) + width + 10] = True
    return taken


def laid(
    sheet: Sheet, scene: Scene, taken: np.ndarray, rng: np.random.Generator, name: str
) -> Sheet | None:
    """Lay one sheet where `taken` (M, N) is free and it stands out; None: found no such place."""
    if scene.background.ndim == 2 and sheet.texture.ndim == 3:
        sheet = replace(sheet, texture=cv2.cvtColor(sheet.texture, cv2.COLOR_BGR2GRAY))
    before = taken.copy()
    place = free_place(taken, sheet.cover.shape, rng)
    if place is None or contrast(sheet, scene, *place) < MIN_CONTRAST:
        taken[:] = before
        return None
    return appearing(sheet, *place, name)


def with_shadows(objects: Sequence[Sheet], strength: float) -> tuple[Sheet, ...]:
    """Return the objects above their shadows; the objects alone for `strength` 0."""
    if strength <= 0:
        return tuple(objects)
    return (*(cast_shadow(sheet, strength) for sheet in objects), *objects)


def contrast(sheet: Sheet, scene: Scene, x: float, y: float) -> float:
    """Return how much an object differs from the ground at x, y in its strongest colour."""
    height, width = sheet.cover.shape
    top, left = scene.margin + int(y), scene.margin + int(x)
    ground = scene.background[top : top + height, left : left + width].astype(float)
    inside = sheet.cover > 0.5
    difference = np.abs(sheet.texture.astype(float) - ground)[inside]
    return float(difference.reshape(len(difference), -1).mean(axis=0).max())


def _photo_scene(photo: np.ndarray, margin: int) -> Scene:
    """Return a scene whose reference is `photo`; beyond its edges it is mirrored."""
    margin = min(margin, min(photo.shape[:2]) - 1)
    return Scene(cv2.copyMakeBorder(photo, *[margin] * 4, cv2.BORDER_REFLECT_101), margin)
