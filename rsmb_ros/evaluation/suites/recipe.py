"""From a recipe to cases: what a suite draws at random, and how a case is made of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Scene, Sheet, Style, Truth, live_frame, reference_image
from rsmb_ros.core.synthesis.exposure import Path
from rsmb_ros.core.synthesis.paths import (
    MOTIONS,
    SIX_DOF,
    blurred_by,
    offset,
    stairs,
    swaying_by,
    wobble,
)
from rsmb_ros.evaluation.case import Case, TrueMotion

from .nuisances import ALL, Range, drawn

REGIMES = {  # rolling, blurred
    'RSMB': (True, True),
    'RS': (True, False),
    'GSMB': (False, True),
    'GS': (False, False),
}
FLAT = Style(houses=0)
NOMINAL_COLS = 640  # lengths in px are for frames that wide and grow with them

Interval = tuple[float, float]


@dataclass(frozen=True)
class Recipe:
    """What cases are drawn from; intervals are uniform, lengths for 640 px of width."""

    style: Style = FLAT
    texture: Interval = (0.6, 1.0)
    objects: tuple[int, int] = (1, 3)
    appear: float = 0.6  # share of the objects that appear; the others vanish
    move: float = 0.2  # share of the cases in which one moves: it is here and was there
    shadows: float = 0.5  # share of the cases whose objects cast a shadow
    moving_shadows: int = 0  # shadows of things out of view, in one image only
    cover: Interval | None = None  # width of one large object, share of the row
    regimes: tuple[str, ...] = ('RSMB',)
    motions: tuple[str, ...] = MOTIONS
    components: np.ndarray = field(default_factory=lambda: SIX_DOF)
    blur_px: Interval = (3.0, 16.0)
    exposure_rows: Interval = (15.0, 100.0)
    sway_px: Interval = (2.0, 12.0)  # of sharp rolling-shutter frames
    offset: Interval = (0.0, 0.05)  # share of the width
    rotation_deg: Interval = (0.0, 1.0)
    zoom: Interval = (0.0, 0.01)
    tilt_deg: Interval = (0.0, 0.25)
    nuisances: Mapping[str, Range] = field(default_factory=lambda: ALL)
    stairs: tuple[int, int] | None = None  # (a, b) of the ECCV 2014 recipe


@dataclass(frozen=True)
class Flown:
    """How the live frame of a case is taken."""

    regime: str
    motion: str
    path: Path
    timing: ShutterTiming
    instants: int | None
    about: Mapping[str, object]


Shot = tuple[Scene, tuple[Sheet, ...]]  # what is seen, and what comes and goes
Scout = Callable[[Recipe, int, np.random.Generator], Shot]  # margin [px] -> what to look at


def simulated(
    name: str,
    recipe: Recipe,
    shape: tuple[int, int],
    number: int,
    rng: np.random.Generator,
    scout: Scout,
) -> Case:
    """
    Make one case.

    Parameters
    ----------
    name : str
        Of the case.
    recipe : Recipe
        What it is drawn from.
    shape : tuple of int
        Rows and columns of reference and live frame [px].
    number : int
        Of the case in its suite: regimes take turns.
    rng : numpy.random.Generator
        Equal seeds give equal bytes.
    scout : callable
        Draws the scene, given the recipe, the margin it needs [px] and the generator.

    """
    flown = fly(recipe, shape, number, rng)
    grid = Grid(shape, shape, Camera.guess(shape[1]).focal_px)
    scene, objects = scout(recipe, margin_of(flown, grid), rng)
    nuisances = drawn(recipe.nuisances, rng)
    reference = reference_image(scene, nuisances, rng, objects)
    live, truth = live_frame(
        scene,
        objects,
        grid,
        flown.path,
        flown.timing,
        nuisances,
        rng,
        instants=flown.instants,
    )
    about = {**flown.about, 'objects': list(truth.names), 'nuisances': nuisances.as_dict()}
    return case_of(name, reference, live, truth, grid.focal_px, about)


def case_of(
    name: str,
    reference: np.ndarray,
    live: np.ndarray,
    truth: Truth,
    focal_px: float,
    about: Mapping[str, object],
) -> Case:
    """Return the case of a synthetic frame."""
    motion = TrueMotion(
        places=truth.places,
        centroids=truth.centroids,
        layers=truth.layers,
        depths=truth.depths,
        exposure_rows=truth.exposure_rows,
        path=truth.path,
        path_start=truth.path_start,
        clean=truth.clean,
    )
    return Case(name, reference, live, truth.label, truth.objects, focal_px, motion, about)


def fly(recipe: Recipe, shape: tuple[int, int], number: int, rng: np.random.Generator) -> Flown:
    """Draw regime, path and timing of a case."""
    scale = shape[1] / NOMINAL_COLS
    regime = recipe.regimes[number % len(recipe.regimes)]
    motion = recipe.motions[int(rng.integers(len(recipe.motions)))]
    rolling, blurred = REGIMES[regime]
    exposure = float(rng.uniform(*recipe.exposure_rows)) if blurred else 0.0
    per_exposure, per_row = recipe.stairs or (0, 0)
    if recipe.stairs:
        per_exposure = per_exposure if blurred else 1
        exposure = per_exposure / per_row
    timing = ShutterTiming(exposure, rolling=rolling)
    moving = wobble(motion, recipe.components, timing, shape[0], rng)
    blur, sway = rng.uniform(*recipe.blur_px) * scale, rng.uniform(*recipe.sway_px) * scale
    if motion == 'constant' and rolling:  # else the frame drifts by many times its blur
        moving = swaying_by(moving, 2.0 * sway, shape[0])
    elif blurred:
        moving = blurred_by(moving, blur, timing, shape[0])
    else:
        moving = swaying_by(moving, sway, shape[0])
    place = _place(recipe, shape[1], rng)
    path = offset(place, moving) if rolling or blurred else offset(place)
    if recipe.stairs:
        steps = (shape[0] - 1) * per_row + per_exposure
        times = (np.arange(steps) - 0.5 * (per_exposure - 1)) / per_row
        path = stairs(path(times), per_row, per_exposure)
    about = {
        'regime': regime,
        'motion': motion,
        'exposure_rows': exposure,
        'blur_px': float(blur) if blurred else 0.0,
        'offset': place.tolist(),
    }
    instants = per_exposure if recipe.stairs else None
    return Flown(regime, motion, path, timing, instants, about)


def margin_of(flown: Flown, grid: Grid) -> int:
    """Return the ground needed beyond the reference so that nothing is made up [px]."""
    rows, cols = grid.live_shape
    reach = 0.5 * flown.timing.exposure_rows
    times = np.linspace(-reach, rows - 1 + reach, 200)
    if not flown.timing.rolling:
        times = flown.timing.middles(1) + np.linspace(-reach, reach, 50)
    hs = homographies(coordinates_from_poses(flown.path(times), grid), grid)
    y, x = (rows - 1) / 2, (cols - 1) / 2
    corners = np.array([(-x, -y, 1), (x, -y, 1), (-x, y, 1), (x, y, 1)]).T
    mapped = hs @ corners
    moved = np.abs(mapped[:, :2] / mapped[:, 2:] - corners[:2])
    return int(np.ceil(moved.max() * 1.02)) + 8


def _place(recipe: Recipe, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the pose (6,) the live frame stays around."""
    angle = rng.uniform(0, 2 * np.pi)
    distance = rng.uniform(*recipe.offset) * cols
    sign = rng.choice([-1.0, 1.0], 4)
    return np.array(
        [
            distance * np.cos(angle),
            distance * np.sin(angle),
            sign[0] * rng.uniform(*recipe.rotation_deg),
            1.0 + sign[1] * rng.uniform(*recipe.zoom),
            sign[2] * rng.uniform(*recipe.tilt_deg),
            sign[3] * rng.uniform(*recipe.tilt_deg),
        ]
    )
