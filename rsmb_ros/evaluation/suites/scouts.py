"""Scenes of the suites: drawn ones and photos, with what comes, goes and moves on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from rsmb_ros.core.synthesis import GONE, Scene, Sheet, aerial_scene, with_shadows
from rsmb_ros.core.synthesis.flight import laid, roofed
from rsmb_ros.core.synthesis.objects import any_object, cast_shadow, enlarged, rounded, soft_blob

from .recipe import NOMINAL_COLS, Recipe, Scout, Shot

TRIES = 20  # places tried for an object
CARS_PX = (24, 64)  # sides of patches of another photo laid down as objects [px]
ROOF_PX = (70, 150)  # sides of patches of another photo put in front as layers [px]


def drawn_scout(shape: tuple[int, int]) -> Scout:
    """Return a scout of procedural scenes whose reference has `shape` (rows, cols)."""

    def scout(recipe: Recipe, margin: int, rng: np.random.Generator) -> Shot:
        style = replace(recipe.style, texture=float(rng.uniform(*recipe.texture)))
        scene = aerial_scene(shape, rng, margin, style)
        other = aerial_scene(shape, rng, 0, style) if recipe.cover else scene
        return scene, things(scene, recipe, rng, other.background)

    return scout


def photo_scout(shape: tuple[int, int], photos: Sequence[np.ndarray], number: int) -> Scout:
    """
    Return a scout of cut-outs of photo `number`; patches of the others become layers and objects.

    A photo too small for the cut-out is enlarged.
    """
    ground, other = photos[number % len(photos)], photos[(number + 3) % len(photos)]

    def scout(recipe: Recipe, margin: int, rng: np.random.Generator) -> Shot:
        rows, cols = shape[0] + 2 * margin, shape[1] + 2 * margin
        smallest = max(rows / ground.shape[0], cols / ground.shape[1])
        zoom = max(smallest, rng.uniform(min(smallest, 1.0), 1.0)) * 1.001
        size = max(cols, int(ground.shape[1] * zoom)), max(rows, int(ground.shape[0] * zoom))
        seen = cv2.resize(ground, size, interpolation=cv2.INTER_AREA)
        y = int(rng.integers(seen.shape[0] - rows + 1))
        x = int(rng.integers(seen.shape[1] - cols + 1))
        layers = tuple(
            _roof(other, shape, rng, n, recipe.style.roof_depth) for n in range(recipe.style.houses)
        )
        layers = tuple(sorted(layers, key=lambda layer: -layer.relative_depth))
        background = np.ascontiguousarray(seen[y : y + rows, x : x + cols])
        scene = Scene(background, margin, layers)
        return scene, things(scene, recipe, rng, other)

    return scout


def things(
    scene: Scene, recipe: Recipe, rng: np.random.Generator, other: np.ndarray
) -> tuple[Sheet, ...]:
    """
    Lay down what a recipe asks for.

    Returns
    -------
    tuple of Sheet
        Shadows first, then the objects.

    """
    taken = roofed(scene)
    zoom = max(1.0, scene.shape[1] / NOMINAL_COLS)
    wanted = int(rng.integers(recipe.objects[0], recipe.objects[1] + 1))
    found: list[Sheet] = []
    if recipe.cover:
        large = _large(other, scene.shape, rng.uniform(*recipe.cover), rng)
        found += _tried(large, scene, np.zeros(scene.shape, bool), rng, 'large object')
    for n in range(wanted):
        sheet = enlarged(_patch(other, rng) if rng.uniform() < 0.3 else any_object(rng), zoom)
        laid_down = _tried(sheet, scene, taken, rng, f'object {n + 1}')
        if laid_down and rng.uniform() >= recipe.appear:
            laid_down = [replace(laid_down[0], kind=GONE)]
        found += laid_down
    if wanted and found and rng.uniform() < recipe.move:
        was = _tried(found[0], scene, taken, rng, f'{found[0].name}, where it was')
        found += [replace(sheet, kind=GONE) for sheet in was]
    shaded = rng.uniform() < recipe.shadows
    shown = with_shadows(found, float(rng.uniform(0.25, 0.5)) if shaded else 0.0)
    return (*_passing_shadows(scene, recipe.moving_shadows, rng), *shown)


def _tried(
    sheet: Sheet, scene: Scene, taken: np.ndarray, rng: np.random.Generator, name: str
) -> list[Sheet]:
    """Return the sheet laid down, or nothing where the scene has no place for it."""
    for _ in range(TRIES):
        placed = laid(sheet, scene, taken, rng, name)
        if placed:
            return [placed]
    return []


def _patch(image: np.ndarray, rng: np.random.Generator) -> Sheet:
    """Return a ragged piece of another image as an object."""
    size = int(rng.integers(*CARS_PX)), int(rng.integers(*CARS_PX))
    return Sheet(_cut(image, size, rng), soft_blob(size, rng, 0.12), 0.0, 0.0)


def _roof(
    image: np.ndarray,
    shape: tuple[int, int],
    rng: np.random.Generator,
    number: int,
    depth: tuple[float, float],
) -> Sheet:
    """Return a rectangular piece of another image as a layer somewhere in the reference."""
    size = int(rng.integers(*ROOF_PX)), int(rng.integers(*ROOF_PX))
    y = rng.uniform(0.05, 0.6) * shape[0]
    x = rng.uniform(0.05, 0.7) * shape[1]
    cover = rounded(size, 1)
    name = f'roof {number + 1}'
    return Sheet(_cut(image, size, rng), cover, x, y, float(rng.uniform(*depth)), name)


def _large(
    image: np.ndarray, shape: tuple[int, int], width: float, rng: np.random.Generator
) -> Sheet:
    """Return an object that covers `width` of the row on a quarter to a half of the rows."""
    size = int(rng.uniform(0.25, 0.5) * shape[0]), int(width * shape[1])
    return Sheet(_cut(image, size, rng), rounded(size, 4), 0.0, 0.0)


def _cut(image: np.ndarray, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    y = int(rng.integers(max(image.shape[0] - size[0], 0) + 1))
    x = int(rng.integers(max(image.shape[1] - size[1], 0) + 1))
    cut = image[y : y + size[0], x : x + size[1]]
    if cut.shape[:2] != size:
        cut = cv2.resize(cut, size[::-1], interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(cut)


def _passing_shadows(scene: Scene, count: int, rng: np.random.Generator) -> tuple[Sheet, ...]:
    """Return shadows of clouds and of things out of view, each in one of the images only."""
    shadows = []
    for n in range(count):
        rows, cols = scene.shape
        size = int(rng.uniform(0.1, 0.4) * rows), int(rng.uniform(0.1, 0.4) * cols)
        caster = Sheet(
            np.zeros(size + scene.background.shape[2:], np.uint8),
            soft_blob(size, rng, 0.2),
            rng.uniform(0.0, 0.7) * scene.shape[1],
            rng.uniform(0.0, 0.7) * scene.shape[0],
            name=f'cloud {n + 1}',
        )
        shadow = cast_shadow(caster, float(rng.uniform(0.2, 0.5)))
        shadows.append(replace(shadow, kind=int(rng.integers(1, 3))))
    return tuple(shadows)
