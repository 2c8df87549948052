"""
Path estimator: one continuous camera path fitted to the whole frame, not rows on their own.

Coarse to fine over a pyramid, on the strongest gradients of the live image; unknowns are
the control points of the path, the light, the defocus, and the exposure when it is not given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from ._kernels.iterate import MOST_CHANGE
from .config import Config
from .level_fit import SHARP_ROWS, LevelFit
from .motion import CameraPath, Grid, spline_weights, still_path
from .normal_equations import Level
from .path_fit import PathFit
from .photometric import Light
from .points import LiveImage, Points
from .reference import Reference
from .sampling import half_pixel, pyramid
from .start import StripMatches, start_path
from .stream import StreamMemory
from .workers import Workers, each
from .workspace import Workspaces

COARSEST_WIDTH = 160  # px; the pyramid ends there
COLD_EXPOSURES = (3.0, 12.0, 36.0, 90.0, 200.0)  # rows, tried when nothing is known
TRIAL = 4  # iterations each of them gets at half size
TRIAL_ROWS = 60  # of points, that are enough to tell exposures apart
# The best two of them are fitted until they stand, unless one costs no more than this share of the
# other, or ...
CLEAR = 0.85
APART = 1.25  # ... the exposures differ by no more than this factor: 94 % of such end as the same
LITTLE = 0.15  # share of LITTLE_ROWS rows, under which foreground has bent the path by little
LITTLE_SHAKING = 0.4  # likewise of a path on denser knots, which small images do not hold
LITTLE_ROWS = 25
# Finest sizes that the next frame of a stream is fitted at, where there are so many: what moves a
# larger image from one frame to the next is beyond its second smallest size.
FOLLOWING_LEVELS = {3: 2}


class PathEstimator:
    """Fits camera paths of live frames of one size to one reference."""

    def __init__(self, reference: Reference, grid: Grid, config: Config, executor: Workers) -> None:
        """Prepare the sizes of `reference`."""
        self._grid = grid
        self._depth = reference.depth
        self._config = config
        self._executor = executor
        self._workspaces = Workspaces()
        count = level_count(grid)
        self._levels = [Level(reference.fine, reference.softer, 0)]
        smaller = zip(pyramid(reference.linear, count), pyramid(reference.soft, count), strict=True)
        for n, (image, softer) in list(enumerate(smaller))[1:]:
            self._levels.append(Level(half_pixel(image), half_pixel(softer), n))

    @property
    def levels(self) -> int:
        """At how many sizes of the images paths are fitted."""
        return len(self._levels)

    def look_at(self, live: LiveImage) -> None:
        """Choose the points of `live` at all sizes, before they are asked for."""
        live.points(len(self._levels))

    def estimate(
        self, live: LiveImage, matches: StripMatches, exposure: float | None = None
    ) -> PathFit:
        """
        Fit the path of `live` from the coarse matches.

        `exposure` [rows], where given, is kept; otherwise the configuration's, or calibrated.

        Never raises on image content: a hopeless frame ends with a large `cost`.
        """
        points = live.points(len(self._levels))
        given = exposure or self._config.shutter.exposure_rows
        if given > 0:
            fit = self._fit_levels(points, self._start(matches, given), 0, free_exposure=False)
        else:
            fit = self._self_calibrated(points, matches)
        return fit

    def follow(self, live: LiveImage, matches: StripMatches, memory: StreamMemory) -> PathFit:
        """Fit the path of the next frame of a stream: blur and light are near the last one's."""
        last = memory.last
        assert last is not None
        given = self._config.shutter.exposure_rows
        start = self._start(matches, given or memory.exposure_rows or last.path.exposure_rows)
        start = replace(start, light=last.light, defocus=last.defocus)
        free = given == 0 and not memory.calibrated
        levels = len(self._levels)
        count = FOLLOWING_LEVELS.get(levels, levels)
        return self._fit_levels(live.points(count), start, 0, free)

    def shaken(self, live: LiveImage, matches: StripMatches, knot_rows: float) -> PathFit:
        """Fit a path with its own `knot_rows` to a frame that shakes too much for the usual."""
        given = self._config.shutter.exposure_rows
        start = self._start(matches, given or SHARP_ROWS, knot_rows)
        return self._fit_levels(live.points(len(self._levels)), start, 0, given == 0)

    def refine(self, live: LiveImage, fit: PathFit, foreground: np.ndarray) -> PathFit:
        """
        Fit the path of `live` again from `fit`, without what is known not to be background.

        `foreground` (M, N) bool marks pixels of static objects at other depths: in rows that they
        dominate, the path had followed them.
        """
        shaking = fit.path.knot_rows < self._config.registration.knot_rows
        # what covers little of every row has not led the path far off, but an exposure may be
        little = _most_of_a_row(foreground) < (LITTLE_SHAKING if shaking else LITTLE)
        count = 1 if little else min(2, len(self._levels))
        masks = pyramid(foreground.astype(np.float32), count)
        points = [
            points.without(mask > 0) for points, mask in zip(live.points(count), masks, strict=True)
        ]
        # where the ground is, is known by now: to be stiff at first would undo it
        return self._fit_levels(points, fit, 0, not fit.exposure_held, near=True)

    def level_fit(self, n: int, points: Points, path: CameraPath, shared: bool = True) -> LevelFit:
        """
        Return what fits `points` of level `n`, at the depths that `path` lets them see.

        The work is `shared` among the threads, or all done by the one that runs it.
        """
        if self._depth is not None:
            points = points.on(self._depth, path, n)
        return LevelFit(
            self._levels[n],
            points,
            self._grid,
            self._config,
            self._executor if shared else None,
            self._workspaces,
        )

    def _start(
        self, matches: StripMatches, exposure: float, knot_rows: float | None = None
    ) -> PathFit:
        bottom_up = self._config.shutter.readout == 'bottom_up'
        knot_rows = knot_rows or self._config.registration.knot_rows
        longest = _longest(exposure)
        path = start_path(matches, self._grid, knot_rows, exposure, longest, bottom_up)
        return PathFit(path, Light.same(), 0.0, 12.0, np.inf, np.zeros((0, 0)), 0.0)

    def _self_calibrated(self, points: Sequence[Points], matches: StripMatches) -> PathFit:
        """
        Try several exposures and finish with the one that fits best.

        The smallest image cannot tell them apart and is fitted once; at half size all are tried
        for a few iterations, the best of them until they stand.
        """
        finest = min(1, len(self._levels) - 1)
        exposures = [e for e in COLD_EXPOSURES if e <= 0.8 * self._grid.live_shape[0]]
        middle = exposures[len(exposures) // 2]
        start = self._fit_levels(points, self._start(matches, middle), finest + 1, False)
        few = points[finest].every(max(1, len(points[finest].rows) // TRIAL_ROWS))

        def trial(exposure: float) -> PathFit:
            fit = _with_exposure(start, exposure)
            # a lens is told apart last: it would take the blur for its own before the exposure has
            # grown to its length, and does not give it back
            lens = exposure <= SHARP_ROWS
            return self._fit_level(finest, few, fit, True, TRIAL, free_defocus=lens)

        def finished(fit: PathFit) -> PathFit:
            return self._fit_level(finest, points[finest], fit, True)

        best, *others = sorted(tried(self._executor, trial, exposures), key=lambda fit: fit.cost)
        rival = others[0] if others else best
        if best.cost > CLEAR * rival.cost and _apart(best, rival) > APART:
            both = each(self._executor, finished, (best, rival))
            best = min(both, key=lambda fit: fit.cost)
        else:
            best = finished(best)
        return self._fit_levels(points[:finest], best, 0, True)

    def _fit_levels(
        self,
        points: Sequence[Points],
        fit: PathFit,
        finest: int,
        free_exposure: bool,
        near: bool = False,
    ) -> PathFit:
        for n in range(len(points) - 1, finest - 1, -1):
            fit = self._fit_level(n, points[n], fit, free_exposure, near=near)
        return fit

    def _fit_level(
        self,
        n: int,
        points: Points,
        fit: PathFit,
        free_exposure: bool,
        most: int | None = None,
        near: bool = False,
        free_defocus: bool = True,
    ) -> PathFit:
        level = self.level_fit(n, points, fit.path)
        return level.run(fit, free_exposure, most, near, free_defocus)


def tried(
    executor: Workers, trial: Callable[[float], PathFit], exposures: Sequence[float]
) -> list[PathFit]:
    """
    Try `exposures` from the middle ones to where the least cost has been tried on both sides.

    A longer one is only tried where the exposure has grown. Whoever is done with one helps the
    others with theirs.
    """
    fits: dict[int, PathFit] = {}
    middle, last = len(exposures) // 2, len(exposures) - 1
    wanted = {middle, min(middle + 1, last)}
    while wanted:
        longest_last = sorted(wanted)  # the last are begun first
        found = each(executor, trial, [exposures[n] for n in longest_last])
        fits.update(zip(longest_last, found, strict=True))
        best = min(sorted(fits), key=lambda n: fits[n].cost)
        wanted = {max(0, best - 1)}
        if fits[best].path.exposure_rows > exposures[best]:
            wanted.add(min(best + 1, last))
        wanted -= fits.keys()
    return list(fits.values())


def _most_of_a_row(mask: np.ndarray) -> float:
    """Largest share of a row that a mask (M, N) bool covers, rows as long as knots are apart."""
    share = mask.mean(axis=1, dtype=np.float32)[:, None]
    return float(cv2.blur(share, (1, LITTLE_ROWS)).max())


def _apart(one: PathFit, other: PathFit) -> float:
    """How many times longer the longer one of two exposures is."""
    ratio = one.path.exposure_rows / other.path.exposure_rows
    return max(ratio, 1.0 / ratio)


def level_count(grid: Grid) -> int:
    """Return at how many sizes of the images a path is fitted."""
    narrower = min(grid.live_shape[1], grid.reference_shape[1])
    return max(1, 1 + round(math.log2(max(1.0, narrower / COARSEST_WIDTH))))


def _longest(exposure: float) -> float:
    """Longest exposure the knots of a path must cover when it starts from `exposure` [rows]."""
    return MOST_CHANGE * exposure + 4.0


def _with_exposure(fit: PathFit, exposure: float) -> PathFit:
    """Return the fit with another exposure, its path on knots that cover that one."""
    old = fit.path
    if exposure == old.exposure_rows:
        return fit
    new = still_path(old.grid, old.knot_rows, exposure, _longest(exposure), old.bottom_up)
    span = old.first_time, len(old.control), new.first_time, len(new.control)
    return replace(fit, path=replace(new, control=_onto(*span, old.knot_rows) @ old.control))


@lru_cache(maxsize=64)
def _onto(
    first_time: float, knots: int, to_first_time: float, to_knots: int, knot_rows: float
) -> np.ndarray:
    """Return what makes control points (knots, 6) of a spline into those of one elsewhere."""
    times = to_first_time + knot_rows * np.arange(0.0, to_knots - 2.5, 0.5)
    basis = spline_weights(times, to_first_time, knot_rows, to_knots)
    return np.linalg.solve(
        basis.T @ basis, basis.T @ spline_weights(times, first_time, knot_rows, knots)
    )
