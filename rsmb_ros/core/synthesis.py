"""
Forward model: live frames with known truth (Eq. 1-5).

A scene is a background and layers at other depths, with objects that come and go. The camera moves
in six degrees of freedom while the rows are read. Light adds up linearly, then comes the tone
curve, then what a camera adds: gain, vignetting, noise, JPEG.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from ._kernels.synthesis import warp_row
from .motion import Grid, coordinates_from_poses, homographies
from .photometric import Light, to_display, to_linear
from .shutter import ShutterTiming

# Truth labels of CDnet.
CHANGED, UNCHANGED, RIM, OUTSIDE = 255, 0, 170, 85
RIM_COVER = 0.05  # an object's blurred rim reaches to this share of the exposure
INSTANTS_PER_PX = 2.0  # instants of the exposure per pixel of motion
Path = Callable[[np.ndarray], np.ndarray]  # times (n,) [rows] -> poses (n, 6)


@dataclass(frozen=True)
class Sheet:
    """A textured plane parallel to the image: a layer, or an object lying on one."""

    texture: np.ndarray  # (R, C) or (R, C, 3) uint8, display values
    cover: np.ndarray  # (R, C) float32, alpha 0..1
    x: float  # column of the texture's left edge in the reference [px], may be negative
    y: float  # row of the texture's top edge in the reference [px]
    relative_depth: float = 1.0  # d_l, background = 1
    name: str = ''


@dataclass(frozen=True)
class Scene:
    """What the camera looks at. Sheets later in a list hide earlier ones."""

    background: np.ndarray  # (R, C) or (R, C, 3) uint8; reference + `margin` on each side
    margin: int  # px of background beyond each edge of the reference
    layers: tuple[Sheet, ...] = ()  # static, in the reference too

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the reference [px]."""
        rows, cols = self.background.shape[:2]
        return rows - 2 * self.margin, cols - 2 * self.margin


@dataclass(frozen=True)
class Nuisances:
    """What a camera adds; the defaults add nothing."""

    gain: float = 1.0  # live / reference, linear light
    bias: float = 0.0  # grey levels of linear light
    vignetting: float = 0.0  # light lost in the corners, 0..1
    noise_electrons: float = np.inf  # electrons at full white: Poisson noise
    read_noise: float = 0.0  # standard deviation [grey levels of linear light]
    jpeg_quality: int = 0  # 1..100, 0: none
    gamma: float = 2.2  # tone curve


@dataclass(frozen=True)
class Truth:
    """What is known about a synthetic frame."""

    label: np.ndarray  # (M, N) uint8, CHANGED, UNCHANGED, RIM or OUTSIDE
    clean: np.ndarray  # (M, N[, 3]) float32, display values without objects, noise and JPEG
    centroids: np.ndarray  # (M, 6) pose tau_c of each row
    exposure_rows: float
    objects: dict[str, tuple[int, int, int, int]] = field(default_factory=dict)  # x, y, w, h [px]


def reference_image(scene: Scene, nuisances: Nuisances, rng: np.random.Generator) -> np.ndarray:
    """Return the reference of a scene: pose zero, no motion, its own noise; uint8."""
    rows, cols = scene.shape
    grid = Grid((rows, cols), (rows, cols), float(cols))
    still = ShutterTiming(0.0, rolling=False)
    clean, _ = _expose(scene, (), grid, _still, still, nuisances.gamma)
    quiet = Nuisances(
        noise_electrons=nuisances.noise_electrons,
        read_noise=nuisances.read_noise,
        jpeg_quality=nuisances.jpeg_quality,
        gamma=nuisances.gamma,
    )
    return _camera(clean, quiet, rng)


def live_frame(
    scene: Scene,
    objects: Sequence[Sheet],
    grid: Grid,
    path: Path,
    timing: ShutterTiming,
    nuisances: Nuisances,
    rng: np.random.Generator,
) -> tuple[np.ndarray, Truth]:
    """
    Expose one live frame.

    Parameters
    ----------
    scene : Scene
        What the reference shows.
    objects : sequence of Sheet
        What is new in the live frame, at reference coordinates.
    grid : Grid
        Sizes of live frame and reference, focal length.
    path : callable
        Poses (n, 6) at times (n,) in rows, 0 = middle of row 0's exposure (top-down).
    timing : ShutterTiming
        Exposure and readout.
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
    clean, outside = _expose(scene, (), grid, path, timing, nuisances.gamma)
    if objects:
        with_objects, _ = _expose(scene, objects, grid, path, timing, nuisances.gamma)
    else:
        with_objects = clean
    label, boxes = _labels(objects, scene, grid, path, timing, outside)
    light = _light(nuisances)
    truth = Truth(
        label=label,
        clean=light.apply(clean, nuisances.gamma),
        centroids=row_centroids(path, timing, grid.live_shape[0]),
        exposure_rows=timing.exposure_rows,
        objects=boxes,
    )
    return _camera(with_objects, nuisances, rng), truth


def row_centroids(path: Path, timing: ShutterTiming, rows: int) -> np.ndarray:
    """Mean pose of each row's exposure (rows, 6)."""
    shares = (np.arange(64) + 0.5) / 64 - 0.5
    times = timing.middles(rows)[:, None] + shares * timing.exposure_rows
    return path(times.ravel()).reshape(rows, 64, 6).mean(axis=1)


def _still(times: np.ndarray) -> np.ndarray:
    return np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0], (len(times), 1))


def _expose(
    scene: Scene,
    objects: Sequence[Sheet],
    grid: Grid,
    path: Path,
    timing: ShutterTiming,
    gamma: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Linear light of a frame (Eq. 2, 5) and the share of the exposure spent outside (M, N)."""
    rows, cols = grid.live_shape
    margin = scene.margin
    background = _planar(to_linear(_with_channels(scene.background), gamma))
    seen = np.zeros((*scene.background.shape[:2], 1))
    seen[margin : margin + scene.shape[0], margin : margin + scene.shape[1]] = 1.0
    if margin == 0:
        seen = np.pad(seen, ((1, 1), (1, 1), (0, 0)))
    # objects lie on the ground: nearer layers hide them
    sheets = [*objects, *scene.layers]
    textures = [to_linear(_with_channels(sheet.texture), gamma).astype(float) for sheet in sheets]
    covers = [_padded_cover(sheet) for sheet in sheets]
    out = np.zeros((rows, cols, background.shape[2]))
    inside = np.zeros((rows, cols, 1))
    total, part, alpha = np.empty(out.shape[1:]), np.empty(out.shape[1:]), np.empty((cols, 1))
    for row, instants in enumerate(_instants(path, timing, rows)):
        ground = homographies(coordinates_from_poses(instants, grid), grid).reshape(-1, 9)
        depths = [_depth_homographies(instants, grid, s.relative_depth) for s in sheets]
        for k, h in enumerate(ground):
            warp_row(background, h, row, _center(grid, margin, margin), total)
            warp_row(seen, h, row, _center(grid, *_seen_margin(margin)), alpha)
            inside[row] += alpha
            for sheet, texture, cover, layer in zip(sheets, textures, covers, depths, strict=True):
                warp_row(cover, layer[k], row, _center(grid, 1 - sheet.x, 1 - sheet.y), alpha)
                if alpha.any():
                    warp_row(texture, layer[k], row, _center(grid, -sheet.x, -sheet.y), part)
                    mix = np.clip(alpha, 0.0, 1.0)
                    total += mix * (part - total)
            out[row] += total
        out[row] /= len(ground)
        inside[row] /= len(ground)
    image = out if scene.background.ndim == 3 else out[..., 0]
    return np.clip(image, 0.0, 255.0).astype(np.float32), 1.0 - np.clip(inside[..., 0], 0, 1)


def _labels(
    objects: Sequence[Sheet],
    scene: Scene,
    grid: Grid,
    path: Path,
    timing: ShutterTiming,
    outside: np.ndarray,
) -> tuple[np.ndarray, dict[str, tuple[int, int, int, int]]]:
    """Truth label of each pixel and the box of each object, from the share of its exposure."""
    rows, cols = grid.live_shape
    label = np.full((rows, cols), UNCHANGED, np.uint8)
    boxes = {}
    for sheet in objects:
        cover = _exposed_cover(sheet, scene.layers, grid, path, timing)
        label[(cover >= RIM_COVER) & (label != CHANGED)] = RIM
        label[cover >= 0.5] = CHANGED
        # fast small things may never cover a pixel for half the exposure: their core counts
        core = cover >= min(0.5, 0.8 * float(cover.max(initial=0.0)) + 1e-6)
        where = np.argwhere(core & (outside < 0.5))
        if len(where) and cover.max() > 0.1:
            label[core] = CHANGED
            (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0) + 1
            boxes[sheet.name] = (int(left), int(top), int(right - left), int(bottom - top))
    label[outside > 1e-3] = OUTSIDE
    return label, boxes


def _exposed_cover(
    sheet: Sheet, layers: Sequence[Sheet], grid: Grid, path: Path, timing: ShutterTiming
) -> np.ndarray:
    """Share of the exposure that a sheet covers each pixel (M, N), what layers hide left out."""
    rows, cols = grid.live_shape
    own, hiding = _padded_cover(sheet), [_padded_cover(layer) for layer in layers]
    out = np.zeros((rows, cols))
    alpha, hidden = np.empty((cols, 1)), np.empty((cols, 1))
    for row, instants in enumerate(_instants(path, timing, rows)):
        for pose in instants[:, None]:
            h = _depth_homographies(pose, grid, sheet.relative_depth)[0]
            warp_row(own, h, row, _center(grid, 1 - sheet.x, 1 - sheet.y), alpha)
            if not alpha.any():
                continue
            for layer, cover in zip(layers, hiding, strict=True):
                h = _depth_homographies(pose, grid, layer.relative_depth)[0]
                warp_row(cover, h, row, _center(grid, 1 - layer.x, 1 - layer.y), hidden)
                alpha *= 1.0 - np.clip(hidden, 0.0, 1.0)
            out[row] += np.clip(alpha[:, 0], 0.0, 1.0) / len(instants)
    return out


def _instants(path: Path, timing: ShutterTiming, rows: int) -> list[np.ndarray]:
    """Poses (n, 6) of each row's exposure, n by how far it moves."""
    shares = (np.arange(9) / 8 - 0.5) * timing.exposure_rows
    middles = timing.middles(rows)
    coarse = path((middles[:, None] + shares).ravel()).reshape(rows, 9, 6)
    moves = np.abs(np.diff(coarse, axis=1)).sum(axis=1)
    # deg and scale in pixels at about 500 px from the centre
    turns = moves[:, [2, 4, 5]].sum(axis=1) * 9 + moves[:, 3] * 500
    length = np.hypot(moves[:, 0], moves[:, 1]) + turns
    counts = np.maximum(1, np.ceil(length * INSTANTS_PER_PX)).astype(int)
    return [
        path(middle + ((np.arange(n) + 0.5) / n - 0.5) * timing.exposure_rows)
        for middle, n in zip(middles, counts, strict=True)
    ]


def _depth_homographies(poses: np.ndarray, grid: Grid, relative_depth: float) -> np.ndarray:
    return homographies(coordinates_from_poses(poses, grid), grid, relative_depth).reshape(-1, 9)


def _center(grid: Grid, left: float, top: float) -> np.ndarray:
    """Centres for `warp_row` of a texture whose pixel (top, left) is reference pixel (0, 0)."""
    return grid.center + np.array([0.0, 0.0, left, top])


def _seen_margin(margin: int) -> tuple[int, int]:
    return (margin, margin) if margin else (1, 1)


def _padded_cover(sheet: Sheet) -> np.ndarray:
    """Alpha with one transparent pixel around, so that edge values continue as nothing."""
    return np.pad(sheet.cover.astype(float), 1)[..., None]


def _with_channels(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 3 else image[..., None]


def _planar(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image, dtype=np.float64)


def _light(nuisances: Nuisances) -> Light:
    """Vignetting as a fall-off with the squared radius, `vignetting` at a 4:3 corner."""
    corner = 1.0 + 0.75**2
    fall = -nuisances.vignetting * nuisances.gain / corner
    return Light(np.array([nuisances.gain, 0.0, 0.0, fall]), nuisances.bias)


def _camera(linear: np.ndarray, nuisances: Nuisances, rng: np.random.Generator) -> np.ndarray:
    """Turn linear light (M, N[, 3]) into the uint8 image a camera would deliver."""
    light = _light(nuisances)
    field_ = light.gain_field(linear.shape[:2])
    if linear.ndim == 3:
        field_ = field_[..., None]
    lit = np.maximum(linear * field_ + nuisances.bias, 0.0)
    if np.isfinite(nuisances.noise_electrons):
        per_level = nuisances.noise_electrons / 255.0
        lit = rng.poisson(lit * per_level) / per_level
    if nuisances.read_noise > 0:
        lit = lit + rng.normal(0.0, nuisances.read_noise, linear.shape)
    image = np.rint(to_display(lit, nuisances.gamma)).astype(np.uint8)
    if nuisances.jpeg_quality:
        _, code = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, nuisances.jpeg_quality])
        image = cv2.imdecode(code, cv2.IMREAD_UNCHANGED)
    return image
