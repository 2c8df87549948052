"""How well an object fits the reference at one relative depth or another."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from ._kernels.depth_energy import POSE, best_depth, pose_table
from .evidence import NoiseTable, Texture
from .motion import CameraPath
from .photometric import Light, to_display
from .render import Shown, Window
from .tone_match import ToneMatch

FINE_STEPS = (0.025, 0.0125, 0.006, 0.003, 0.0015)
MAX_Z2 = 16.0  # truncation of the energy that depths are compared by
COARSE_APART = 0.5  # px that two depths must move an object apart for both to be asked
FINE_APART = 0.04  # px; smaller steps of the depth change nothing
ENOUGH = (600, 6000)  # pixels of an object that are asked, about, at first and finally
SPACINGS = (3.0, 2.0)  # px between the instants of the exposure, at first and finally
POSE_SPACING = 0.5  # rows between the poses that all instants' are interpolated from
CURVE_SIZE = 1024  # display values of light

Render = Callable[[float, Window, tuple[float, float]], Shown]


class BestDepth(NamedTuple):
    """The relative depth that an object fits best at."""

    depth: float  # d_l
    energy: float  # mean truncated z^2 there
    background: float  # and at the background's depth


class DepthEnergy(ABC):
    """
    Compares what the reference shows at relative depths with a live frame.

    The noise is taken for that of the live frame's own texture, so that all depths are measured
    alike.
    """

    def __init__(self, live: np.ndarray, noise: NoiseTable) -> None:
        self._live = live
        self._noise = noise

    @abstractmethod
    def best(self, window: Window, mask: np.ndarray, depths: np.ndarray, reach: float) -> BestDepth:
        """
        Find the depth at which an object, a window's `mask`, fits best: near one of `depths`.

        `reach` is how far 1 in 1/d moves it [px].
        """

    def _asked(self, window: Window, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a window of the live frame, and 1 / sigma^2 of what the mask holds, else 0."""
        live = np.ascontiguousarray(self._live[window.box])
        return live, mask / self._noise.variances[Texture.of(live).code]


class RenderedEnergy(DepthEnergy):
    """Compares depths by rendering each, whichever way a frame is rendered."""

    def __init__(self, live: np.ndarray, noise: NoiseTable, render: Render) -> None:
        super().__init__(live, noise)
        self._render = render

    def best(self, window: Window, mask: np.ndarray, depths: np.ndarray, reach: float) -> BestDepth:
        """Find the depth at which an object fits best."""
        live, weight = self._asked(window, mask)

        def energy(depth: float) -> float:
            own = self._render(depth, window, (0.0, 0.0))
            z2 = (live - own.grey) ** 2 * weight
            return float(np.where(own.complete, np.minimum(z2, MAX_Z2), MAX_Z2)[mask].mean())

        energies = [energy(depth) for depth in depths]
        least = int(np.argmin(energies))
        best = (energies[least], float(depths[least]))
        for step in FINE_STEPS:
            middle = best[1]
            best = min(best, *((energy(d), d) for d in (middle - step, middle + step)))
        return BestDepth(best[1], best[0], energy(1.0))


@dataclass(frozen=True)
class Sight:
    """What a live frame sees of the reference, and how."""

    fine: np.ndarray  # (2M, 2N) float32 linear light, see `sampling.half_pixel`
    path: CameraPath
    light: Light
    gamma: float
    tones: ToneMatch | None = None

    @property
    def curve(self) -> np.ndarray:
        """Grey levels over the root of light's share of 255, evenly spaced 0..1, float32."""
        curve = _display_curve(self.gamma)
        return curve if self.tones is None else self.tones.of_grey(curve)

    @cached_property
    def first_time(self) -> float:
        """Time of the first of `poses` [rows]."""
        return -0.5 * self.path.exposure_rows - 1.0

    @cached_property
    def poses(self) -> np.ndarray:
        """Homographies of all instants of the frame, `POSE_SPACING` rows apart (T, 12)."""
        path, grid = self.path, self.path.grid
        rows = grid.live_shape[0] + path.exposure_rows + 2.0
        out = np.empty((int(np.ceil(rows / POSE_SPACING)) + 1, POSE))
        pose_table(
            self.first_time, POSE_SPACING, path.control, path.first_time, path.knot_rows,
            grid.focal_px, grid.half_width, out,
        )  # fmt: skip
        return out

    @cached_property
    def instants(self) -> np.ndarray:
        """Instants of each row if they are 1 px apart (M,)."""
        return self.path.samples_per_row(1.0)


class PathEnergy(DepthEnergy):
    """Compares depths in the grey levels of a frame that one camera path registers."""

    def __init__(self, live: np.ndarray, noise: NoiseTable, sight: Sight) -> None:
        super().__init__(live, noise)
        self._sight = sight

    def best(self, window: Window, mask: np.ndarray, depths: np.ndarray, reach: float) -> BestDepth:
        """Find the depth at which an object fits best; of a large one, only some rows are asked."""
        live, weight = self._asked(window, mask)
        sight, path = self._sight, self._sight.path
        number = np.count_nonzero(mask, axis=1)
        begin, end = mask.argmax(axis=1), mask.shape[1] - mask[:, ::-1].argmax(axis=1)
        extents = np.stack([begin, np.where(number > 0, end, begin), number], axis=1)
        strides = np.array([max(1, int(number.sum()) // enough) for enough in ENOUGH])
        rows = slice(window.top, window.bottom)
        found = np.empty(3)
        best_depth(
            np.asarray(depths, np.float64), COARSE_APART, np.array(FINE_STEPS), FINE_APART, reach,
            strides, np.array(SPACINGS), window.top, window.left, live, weight, extents,
            sight.fine.ravel(), *sight.fine.shape,
            (path.row_times[rows] - sight.first_time) / POSE_SPACING,
            path.exposure_rows / POSE_SPACING, sight.instants[rows], sight.poses, path.grid.center,
            sight.light.gain.astype(np.float32), np.float32(sight.light.bias),
            sight.curve, MAX_Z2, found,
        )  # fmt: skip
        return BestDepth(*(float(value) for value in found))


@lru_cache(maxsize=4)
def _display_curve(gamma: float) -> np.ndarray:
    """Display values over the root of light's share of 255, evenly spaced 0..1, float32."""
    roots = np.linspace(0.0, 1.0, CURVE_SIZE + 1, dtype=np.float32)
    return to_display(np.float32(255.0) * roots * roots, gamma)
