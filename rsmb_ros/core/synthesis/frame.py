"""Reference and live frames of a scene, with everything that is true of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming

from .exposure import THREADS, Exposure, Path, expose, row_centroids
from .paths import still
from .scene import Scene, Sheet
from .sensor import Nuisances, develop, in_tones

# Truth labels of CDnet.
CHANGED, UNCHANGED, RIM, OUTSIDE = 255, 0, 170, 85
RIM_COVER = 0.05  # an object's blurred rim reaches to this share of the exposure
OUTSIDE_SHARE = 1e-3  # of the exposure, from which on a pixel has not been seen before


@dataclass(frozen=True)
class Truth:
    """What is known about a synthetic frame of M x N px."""

    label: np.ndarray  # (M, N) uint8, CHANGED, UNCHANGED, RIM (shadows too) or OUTSIDE
    objects: np.ndarray  # (M, N) uint8, n: changed by `names[n - 1]`, 0: by none
    names: tuple[str, ...]  # of the objects that are in view
    clean: np.ndarray  # (M, N[, 3]) float32, display values of the reference, no noise, no JPEG
    places: np.ndarray  # (M, N, 2) float32, x, y in the reference, mean over the exposure [px]
    layers: np.ndarray  # (M, N) uint8, n: `depths[n - 1]` is in front, 0: the ground
    depths: tuple[float, ...]  # relative depth of each layer
    centroids: np.ndarray  # (M, 6) pose tau_c of each row
    path: np.ndarray  # (T, 6) poses at the row times path_start, path_start + 1, ...
    path_start: int  # [rows]; before 0: row 0's exposure begins half of it earlier
    exposure_rows: float

    @property
    def boxes(self) -> dict[str, tuple[int, int, int, int]]:
        """Box x, y, width, height of each object [px]."""
        boxes = {}
        for number, name in enumerate(self.names, 1):
            rows, cols = np.nonzero(self.objects == number)
            top, left = int(rows.min()), int(cols.min())
            boxes[name] = (left, top, int(cols.max()) - left + 1, int(rows.max()) - top + 1)
        return boxes


def reference_image(
    scene: Scene,
    nuisances: Nuisances,
    rng: np.random.Generator,
    objects: Sequence[Sheet] = (),
    threads: int = THREADS,
) -> np.ndarray:
    """Return the reference of a scene: pose zero, no motion, gone objects, its own noise; uint8."""
    rows, cols = scene.shape
    grid = Grid((rows, cols), (rows, cols), float(cols))
    instant = ShutterTiming(0.0, rolling=False)
    seen = expose(
        scene,
        objects,
        grid,
        still,
        instant,
        nuisances.gamma,
        distortion=nuisances.distortion,
        threads=threads,
    )
    return develop(seen.before, nuisances.of_reference, rng)


def live_frame(
    scene: Scene,
    objects: Sequence[Sheet],
    grid: Grid,
    path: Path,
    timing: ShutterTiming,
    nuisances: Nuisances,
    rng: np.random.Generator,
    *,
    instants: int | None = None,
    threads: int = THREADS,
) -> tuple[np.ndarray, Truth]:
    """
    Take one live frame.

    Parameters
    ----------
    scene, objects, grid, path, timing, instants, threads
        As `exposure.expose` takes them.
    nuisances : Nuisances
        What the camera adds.
    rng : numpy.random.Generator
        Source of the noise; equal seeds give equal images.

    Returns
    -------
    live : ndarray, uint8
        (M, N) or (M, N, 3) as the scene's background.
    truth : Truth
        What is in it.

    """
    seen = expose(
        scene,
        objects,
        grid,
        path,
        timing,
        nuisances.gamma,
        distortion=nuisances.distortion,
        instants=instants,
        threads=threads,
    )
    label, numbers, names = _labels(objects, seen)
    clean = in_tones(nuisances.light.apply(seen.before, nuisances.gamma), nuisances)
    layers = seen.cover[1 + len(objects) :]
    reach = int(np.ceil(0.5 * timing.exposure_rows))
    front = (layers >= 0.5) * np.arange(1, len(layers) + 1)[:, None, None]
    truth = Truth(
        label=label,
        objects=numbers,
        names=names,
        clean=clean if scene.background.ndim == 3 else clean[..., 0],
        places=seen.places,
        layers=front.max(axis=0, initial=0).astype(np.uint8),
        depths=tuple(layer.relative_depth for layer in scene.layers),
        centroids=row_centroids(path, timing, grid.live_shape[0]),
        path=path(np.arange(-reach, grid.live_shape[0] + reach, dtype=np.float64)),
        path_start=-reach,
        exposure_rows=timing.exposure_rows,
    )
    return develop(seen.light, nuisances, rng), truth


def _labels(
    objects: Sequence[Sheet], seen: Exposure
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Truth label and object number of each pixel, from the share of its exposure."""
    label = np.full(seen.outside.shape, UNCHANGED, np.uint8)
    numbers = np.zeros_like(label)
    names: list[str] = []
    outside = seen.outside > OUTSIDE_SHARE
    for sheet, cover in zip(objects, seen.cover[1:], strict=False):
        label[(cover >= RIM_COVER) & (label != CHANGED)] = RIM
        if sheet.shadow:
            continue
        # fast small things may never cover a pixel for half the exposure: their core counts
        peak = float(cover.max(initial=0.0))
        core = (cover >= min(0.5, 0.8 * peak + 1e-6)) & ~outside
        if peak > 0.1 and core.any():
            names.append(sheet.name)
            label[core] = CHANGED
            numbers[core] = len(names)
    label[outside] = OUTSIDE
    hidden = [n for n in range(1, len(names) + 1) if not (numbers == n).any()]
    for n in reversed(hidden):  # by a later object
        numbers[numbers > n] -= 1
        del names[n - 1]
    return label, numbers, tuple(names)
