"""A reference of known depth as a live frame shows it: all layers at once (Eq. 5)."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ._kernels.depth import MIXED, TILE, ask_tiles, composite_rows
from .depth_map import DepthMap
from .motion import CameraPath
from .render import STEP_PX, Window, blurred
from .sampling import half_pixel
from .workers import Workers, shared

TILE_STEP = 4.0  # px between the instants a tile is asked at
TILE_REACH = 10  # px: half a tile's diagonal, half a step, rounding, 10 % of turn and zoom
SPARSE = 1 / 16  # of its window; a layer seen less is rendered pixel by pixel
MOST_STRETCH = 2.0  # nearer layers than 1/2 get no more instants
UNKNOWN_DEPTHS = 5  # places that something of unknown depth is looked for at
EDGE = 2  # px: edges of a depth map are known to this ...
MISPLACED = 0.5  # px ... and matter where they would move what is seen by more than this
FAINT = 0.01  # share of the exposure; what shows for less is not there


class Rendered(NamedTuple):
    """A reference through its layers, (M, N) float32 each."""

    image: np.ndarray  # mean over the known part of the exposure; 0 where none is
    known: np.ndarray  # share of the exposure of which the reference knows what is seen, 0..1
    sure: np.ndarray  # of it, what no small fault of the map would change, 0..known


class Composition:
    """
    Which layer each pixel of a live frame shows.

    Parameters
    ----------
    depth : DepthMap
        Of the reference.
    path : CameraPath
        Of the live frame.
    executor : Workers
        Threads that share the rows.

    """

    def __init__(self, depth: DepthMap, path: CameraPath, executor: Workers) -> None:
        self._depth = depth
        self._path = path
        self._executor = executor
        stretch = float(np.clip(depth.inverse_depths[0], 1.0, MOST_STRETCH))
        self._samples = path.samples_per_row(STEP_PX, stretch)
        self._bits, self._sole = self._asked()
        self._windows: list[tuple[int, Window]] = []
        for n in range(len(depth.inverse_depths)):
            found = self._window(n)
            if found is not None:
                self._windows.append((n, found))

    def render(self, fine: np.ndarray) -> Rendered:
        """Warp and blur a reference (2M, 2N), see `sampling.half_pixel`, through its layers."""
        rows, cols = self._path.grid.live_shape
        image, known, sure = np.zeros((3, rows, cols), np.float32)
        for n, window in self._windows:
            own = np.repeat(np.repeat(self._sole == n, TILE, axis=0), TILE, axis=1)
            inside = own[:rows, :cols][window.box]
            part, complete = blurred(
                fine, self._path, self._executor, 1.0 / self._depth.inverse_depths[n], window
            )
            image[window.box][inside] = part[inside]
            known[window.box][inside] = sure[window.box][inside] = complete[inside]
        self._add_mixed(fine, image, known, sure)
        return Rendered(image, known, sure)

    def unknown(self) -> np.ndarray:
        """Where something of unknown depth may be seen, (M, N) bool."""
        found = np.zeros(self._path.grid.live_shape, bool)
        if self._depth.unknown.any():
            fine = half_pixel(self._depth.unknown.astype(np.float32))
            near, far = self._depth.inverse_depths[[0, -1]]
            for inverse in np.linspace(near, far, UNKNOWN_DEPTHS):
                found |= blurred(fine, self._path, self._executor, 1.0 / inverse)[0] > FAINT
        return found

    def _asked(self) -> tuple[np.ndarray, np.ndarray]:
        """Return for each tile what it may show (bits), and the layer it shows alone or -1."""
        path, depth = self._path, self._depth
        rows, cols = path.grid.live_shape
        shape = -(-rows // TILE), -(-cols // TILE)
        bits, sole = np.zeros(shape, np.uint32), np.zeros(shape, np.int64)
        edges = np.minimum(np.arange(shape[0] + 1) * TILE, rows)
        ends = np.stack([path.row_times[edges[:-1]], path.row_times[edges[1:] - 1]])
        begin = ends.min(axis=0) - 0.5 * path.exposure_rows
        duration = ends.max(axis=0) + 0.5 * path.exposure_rows - begin
        longer = duration.max() / max(path.exposure_rows, 1.0)
        count = int(self._samples.max() * max(1.0, longer) * STEP_PX / TILE_STEP) + 2
        possible, certain = depth.possible(TILE_REACH), depth.certain(TILE_REACH)
        smooth = cv2.copyMakeBorder(
            depth.smooth(TILE_REACH), *[TILE_REACH] * 4, cv2.BORDER_CONSTANT, value=0
        )

        def run(first: int, last: int) -> None:
            ask_tiles(
                first, last, begin, duration, count, path.control, path.first_time,
                path.knot_rows, path.grid.focal_px, path.grid.center, depth.inverse_depths,
                possible, certain, smooth, depth.exact, TILE_REACH, bits, sole,
            )  # fmt: skip

        shared(self._executor, run, shape[0], rows * cols)
        return bits, sole

    def _window(self, n: int) -> Window | None:
        """Return what holds the tiles of layer `n`; few tiles are left to the pixels."""
        own = self._sole == n
        if not own.any():
            return None
        top, bottom = np.flatnonzero(own.any(axis=1))[[0, -1]]
        left, right = np.flatnonzero(own.any(axis=0))[[0, -1]]
        if own.sum() < SPARSE * (bottom + 1 - top) * (right + 1 - left):
            self._sole[own] = MIXED
            return None
        rows, cols = self._path.grid.live_shape
        return Window(
            int(top) * TILE,
            min(rows, (int(bottom) + 1) * TILE),
            int(left) * TILE,
            min(cols, (int(right) + 1) * TILE),
        )

    def _add_mixed(self, fine: np.ndarray, *out: np.ndarray) -> None:
        """Write image, known and sure of the tiles that show several layers."""
        path, depth, rows = self._path, self._depth, len(out[0])
        times, flat = path.row_times, fine.ravel()
        near, uneven = depth.possible(EDGE), depth.uneven(EDGE)

        def run(first: int, last: int) -> None:
            composite_rows(
                first, last, self._bits, self._sole, flat,
                fine.shape[1], depth.members, near, EDGE, depth.surface, uneven,
                depth.inverse_depths, MISPLACED, times, self._samples, path.control,
                path.first_time, path.knot_rows, path.exposure_rows, path.grid.focal_px,
                path.grid.center, *out,
            )  # fmt: skip

        shared(self._executor, run, rows, out[0].size)
