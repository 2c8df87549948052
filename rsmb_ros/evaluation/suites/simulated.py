"""The suites that need nothing but a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsmb_ros.core.synthesis import Style

from .nuisances import LINEAR, OTHER_TONES, STRONG_LIGHT
from .recipe import Recipe
from .suite import Suite, drawn_suite

PLANAR = Recipe()
# Roofs at the depths of real ones: some to 25 % of the flying height above ground; trees lower.
HOUSES = Style(houses=2, roof_depth=(0.75, 0.97), crowns=2)
LAYERED = Recipe(style=HOUSES)
WOOD = Style(houses=0, crowns=10, crown_depth=(0.9, 0.98))
BARE = Style(houses=0, roads=0.0, trees=4)
REGIMES = ('RSMB', 'RS', 'GSMB', 'GS')


def quiet(recipe: Recipe) -> Recipe:
    """Return the recipe without any change."""
    return replace(recipe, objects=(0, 0), cover=None)


UNCHANGED = (
    quiet(PLANAR),
    quiet(LAYERED),
    quiet(Recipe(style=HOUSES, regimes=REGIMES)),
    quiet(Recipe(style=HOUSES, nuisances=STRONG_LIGHT)),
    quiet(Recipe(style=WOOD)),
    quiet(Recipe(style=HOUSES, offset=(0.05, 0.1), blur_px=(10.0, 24.0))),
)

# The recipe of the ECCV 2014 paper: a = 20 poses a row, b = 3 from row to row, intensities added
# as they are; rolling shutter alone: a = 1. The size of the motion is not published: ours.
_TWO = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # t_x, t_y
_THREE = np.array([1.0, 1.0, 0.02, 0.0, 0.0, 0.0])  # t_x, t_y, r_z
_FREE = Recipe(
    components=_THREE,
    stairs=(20, 3),
    nuisances=LINEAR,
    motions=('smooth', 'jello', 'walk'),
    blur_px=(2.0, 6.0),
    sway_px=(5.0, 20.0),
    offset=(0.0, 0.02),
    zoom=(0.0, 0.0),
    tilt_deg=(0.0, 0.0),
)
_EVEN = replace(_FREE, motions=('constant',))
_3D = Style(houses=2, roof_depth=(0.4, 0.9), roads=0.0)
AUTHORS = {
    'motion 2D uniform': replace(quiet(_EVEN), components=_TWO, rotation_deg=(0.0, 0.0)),
    'motion 2D nonuniform': replace(quiet(_FREE), components=_TWO, rotation_deg=(0.0, 0.0)),
    'motion 3D uniform': quiet(_EVEN),
    'motion 3D nonuniform': quiet(_FREE),
    'planar RSMB': _FREE,
    'planar RS': replace(_FREE, regimes=('RS',)),
    '3D RSMB': replace(_FREE, style=_3D),
    '3D RS': replace(_FREE, style=_3D, regimes=('RS',)),
}

SIMULATED: tuple[Suite, ...] = (
    drawn_suite(
        'quick',
        'a little of everything at 320x240, for tests',
        6,
        (
            PLANAR,
            LAYERED,
            quiet(PLANAR),
            Recipe(style=HOUSES, regimes=('RS',)),
            quiet(LAYERED),
            Recipe(offset=(0.1, 0.2), rotation_deg=(1.0, 5.0), zoom=(0.01, 0.05)),
        ),
        shape=(240, 320),
    ),
    drawn_suite('planar', 'flat ground, objects come, go and move', 24, (PLANAR,)),
    drawn_suite('layered', 'houses and trees in front of the ground', 24, (LAYERED,)),
    drawn_suite(
        'regimes',
        'global and rolling shutter, sharp and blurred; flat and layered',
        24,
        (Recipe(regimes=REGIMES), Recipe(style=HOUSES, regimes=REGIMES)),
    ),
    drawn_suite(
        'far',
        'offset 10 to 20 % of the frame, up to 5 deg and 5 % of scale',
        20,
        (
            Recipe(offset=(0.1, 0.2), rotation_deg=(0.0, 5.0), zoom=(0.0, 0.05)),
            Recipe(style=HOUSES, offset=(0.1, 0.2), rotation_deg=(0.0, 5.0), zoom=(0.0, 0.05)),
        ),
    ),
    drawn_suite(
        'light',
        'other exposure, haze, vignetting, passing shadows; half of the cases unchanged',
        16,
        (
            Recipe(nuisances=STRONG_LIGHT, moving_shadows=1),
            quiet(Recipe(nuisances=STRONG_LIGHT, moving_shadows=2)),
        ),
    ),
    drawn_suite(
        'tones',
        'contrast and white balance of another camera; half of the cases unchanged',
        16,
        (Recipe(nuisances=OTHER_TONES), quiet(Recipe(style=HOUSES, nuisances=OTHER_TONES))),
    ),
    drawn_suite(
        'weak-texture',
        'bare ground, contrast 4 to 25 % of the usual one',
        16,
        (Recipe(style=BARE, texture=(0.04, 0.25)),),
    ),
    drawn_suite(
        'big-change',
        'one object over 30 to 50 % of the width and a quarter to a half of the rows',
        16,
        (Recipe(objects=(0, 1), cover=(0.3, 0.5)), Recipe(objects=(0, 0), cover=(0.3, 0.5))),
    ),
    drawn_suite('nochange', 'nothing changed: flat, houses, trees, light, far', 36, UNCHANGED),
    drawn_suite(
        'authors',
        'recipe and motion classes of the papers',
        32,
        tuple(AUTHORS.values()),
        shape=(256, 384),
        groups=tuple(AUTHORS),
        settings={'camera.gamma': 1.0},
    ),
)
