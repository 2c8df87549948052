"""Eq. 1-5: light that falls on each row while the camera moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import spline_filter1d

from rsmb_ros.core._kernels.synthesis import expose_rows
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.photometric import to_linear
from rsmb_ros.core.shutter import ShutterTiming

from .scene import STATIC, Scene, Sheet

INSTANTS_PER_PX = 2.0  # instants of the exposure per pixel of motion
CENTROID_SAMPLES = 64
CHUNK_ROWS = 16  # rows a thread takes at a time
THREADS = 2
PAD = 2  # px around a sheet: its colour goes on, its alpha ends

Path = Callable[[np.ndarray], np.ndarray]  # times (n,) [rows] -> poses (n, 6)


@dataclass(frozen=True)
class Exposure:
    """Linear light and geometry of one frame of M x N px."""

    light: np.ndarray  # (M, N, C) float64, 0..255, static and new sheets
    before: np.ndarray  # (M, N, C) float64, the same camera on what the reference showed
    cover: np.ndarray  # (planes, M, N) float32, share of the exposure each plane is seen; 0: ground
    places: np.ndarray  # (M, N, 2) float32, x, y in the reference, mean over the exposure [px]
    outside: np.ndarray  # (M, N) float32, share of the exposure beyond the reference


def expose(
    scene: Scene,
    objects: Sequence[Sheet],
    grid: Grid,
    path: Path,
    timing: ShutterTiming,
    gamma: float,
    *,
    distortion: float = 0.0,
    instants: int | None = None,
    threads: int = THREADS,
) -> Exposure:
    """
    Sum the light of every row over its exposure (Eq. 2, 5).

    Parameters
    ----------
    scene : Scene
        Ground and static layers.
    objects : sequence of Sheet
        New and gone ones, at reference coordinates; layers hide them.
    grid : Grid
        Sizes of live frame and reference, focal length.
    path : callable
        Poses (n, 6) at times (n,) in rows, 0 = middle of row 0's exposure (top-down).
    timing : ShutterTiming
        Exposure and readout.
    gamma : float
        Tone curve of the textures.
    distortion : float
        Radial: a point at half the width comes from ``1 + distortion`` times as far out.
    instants : int, optional
        Instants a row; default: two per pixel of its motion.
    threads : int
        Rows are shared among so many; the result does not depend on it.

    """
    rows, cols = grid.live_shape
    planes = _Planes.of(scene, [*objects, *scene.layers], gamma)
    poses = row_instants(path, timing, rows, instants)
    counts = np.array([len(row) for row in poses], np.int64)
    begins = np.concatenate([[0], np.cumsum(counts)[:-1]])
    hs = _homographies(np.concatenate(poses), grid, planes.depths)
    light, before = np.zeros((2, rows, cols, planes.channels))
    cover = np.zeros((len(planes.depths), rows, cols), np.float32)
    places = np.zeros((rows, cols, 2))
    outside = np.zeros((rows, cols), np.float32)

    def work(first: int) -> None:
        expose_rows(
            first, min(first + CHUNK_ROWS, rows), planes.flat, planes.starts, planes.shapes,
            planes.corners, planes.kinds, hs, counts, begins, grid.center, grid.half_width,
            distortion, planes.channels, light, before, cover, places, outside,
        )  # fmt: skip

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(0, rows, CHUNK_ROWS)))
    return Exposure(
        np.clip(light, 0.0, 255.0),
        np.clip(before, 0.0, 255.0),
        cover,
        places.astype(np.float32),
        outside,
    )


@dataclass(frozen=True)
class _Planes:
    """Ground and sheets in the form the kernel takes them, the ground first."""

    flat: np.ndarray  # what `sample` reads of all planes, one after the other
    starts: np.ndarray  # (planes,) where each begins in `flat`
    shapes: np.ndarray  # (planes, 2) rows and columns
    corners: np.ndarray  # (planes, 2) column and row of the reference's corner in each
    kinds: np.ndarray  # (planes,) STATIC, NEW or GONE
    depths: tuple[float, ...]  # relative
    channels: int

    @classmethod
    def of(cls, scene: Scene, sheets: Sequence[Sheet], gamma: float) -> _Planes:
        ground = _with_channels(scene.background)
        packed = [_packed(ground, np.ones(ground.shape[:2]), gamma, 0)]
        packed += [
            _packed(_with_channels(sheet.texture), sheet.cover, gamma, PAD) for sheet in sheets
        ]
        ends = np.cumsum([plane.size for plane in packed])
        corners = [(scene.margin, scene.margin), *((PAD - s.x, PAD - s.y) for s in sheets)]
        return cls(
            flat=np.concatenate([plane.ravel() for plane in packed]),
            starts=np.concatenate([[0], ends[:-1]]).astype(np.int64),
            shapes=np.array([plane.shape[:2] for plane in packed], np.int64),
            corners=np.array(corners, np.float64),
            kinds=np.array([STATIC, *(sheet.kind for sheet in sheets)], np.int64),
            depths=(1.0, *(sheet.relative_depth for sheet in sheets)),
            channels=ground.shape[2],
        )


def _homographies(poses: np.ndarray, grid: Grid, depths: Sequence[float]) -> np.ndarray:
    """Homographies (n, planes, 9) of poses (n, 6) for planes at relative `depths`."""
    coordinates = coordinates_from_poses(poses, grid)
    by_depth = {d: homographies(coordinates, grid, d).reshape(-1, 9) for d in set(depths)}
    return np.stack([by_depth[d] for d in depths], axis=1)


def row_centroids(path: Path, timing: ShutterTiming, rows: int) -> np.ndarray:
    """Mean pose of each row's exposure (rows, 6)."""
    shares = (np.arange(CENTROID_SAMPLES) + 0.5) / CENTROID_SAMPLES - 0.5
    times = timing.middles(rows)[:, None] + shares * timing.exposure_rows
    return path(times.ravel()).reshape(rows, CENTROID_SAMPLES, 6).mean(axis=1)


def row_instants(
    path: Path, timing: ShutterTiming, rows: int, instants: int | None = None
) -> list[np.ndarray]:
    """Poses (n, 6) of each row's exposure, n by how far it moves or as given."""
    middles = timing.middles(rows)
    if instants is None:
        shares = (np.arange(9) / 8 - 0.5) * timing.exposure_rows
        coarse = path((middles[:, None] + shares).ravel()).reshape(rows, 9, 6)
        counts = np.ceil(pixel_moves(coarse).sum(axis=1) * INSTANTS_PER_PX).astype(int)
        counts = np.maximum(counts, 1)
    else:
        counts = np.full(rows, instants)
    return [
        path(middle + ((np.arange(n) + 0.5) / n - 0.5) * timing.exposure_rows)
        for middle, n in zip(middles, counts, strict=True)
    ]


def pixel_moves(poses: np.ndarray) -> np.ndarray:
    """Motion between consecutive poses (..., n, 6) at some 500 px from the centre, (..., n-1)."""
    moves = np.abs(np.diff(poses, axis=-2))
    turns = moves[..., [2, 4, 5]].sum(axis=-1) * 9 + moves[..., 3] * 500
    return np.hypot(moves[..., 0], moves[..., 1]) + turns


def _packed(texture: np.ndarray, cover: np.ndarray, gamma: float, pad: int) -> np.ndarray:
    """Splines of the linear light, and alpha (R, C, channels + 1): edges go on, alpha ends."""
    around = ((pad, pad), (pad, pad))
    light = np.pad(to_linear(texture, gamma), (*around, (0, 0)), mode='edge')
    for axis in (0, 1):
        light = spline_filter1d(light, axis=axis, output=np.float32)
    alpha = np.pad(cover, around).astype(np.float32)
    return np.concatenate([light, alpha[..., None]], axis=2)


def _with_channels(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 3 else image[..., None]
