"""Procedural aerial ground: fields, roads, trees, parked cars, houses and crowns in front."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from .objects import CAR_COLORS, car, rounded, soft_blob
from .scene import Scene, Sheet

ROOF_COLORS = ((82, 98, 158), (96, 96, 102), (70, 84, 108), (150, 156, 160))
ASPHALT, GRAVEL, LINE = (92, 94, 96), (126, 140, 150), (205, 210, 212)  # BGR
BASE_PIXELS = 640 * 480  # the numbers of a style are for a reference of this size


@dataclass(frozen=True)
class Style:
    """What is drawn, per 640 x 480 px of reference."""

    houses: int = 2  # gable roofs, layers
    crowns: int = 0  # single trees that stand out, layers
    trees: int = 46  # painted on the ground
    parked: int = 3  # cars
    roads: float = 0.85  # share of the directions that have one
    texture: float = 1.0  # contrast of the ground's texture, 0..1
    roof_depth: tuple[float, float] = (0.86, 0.9)  # relative depth, from, to
    crown_depth: tuple[float, float] = (0.93, 0.98)


SUBURB = Style()


def aerial_scene(
    shape: tuple[int, int], rng: np.random.Generator, margin: int = 80, style: Style = SUBURB
) -> Scene:
    """
    Draw a suburb seen from above, in colour.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the reference [px].
    rng : numpy.random.Generator
        Equal seeds give equal scenes.
    margin : int
        Ground drawn beyond each edge of the reference [px].
    style : Style
        What is drawn.

    """
    rows, cols = shape[0] + 2 * margin, shape[1] + 2 * margin
    area = shape[0] * shape[1] / BASE_PIXELS
    ground = _fields(rows, cols, style.texture, rng)
    road_y = margin + int(rng.uniform(0.5, 0.65) * shape[0])
    road_x = margin + int(rng.uniform(0.3, 0.45) * shape[1])
    crossing, along = rng.uniform(size=2) < style.roads
    taken = np.zeros(shape, bool)
    if crossing:
        _road(ground, road_y, rng, horizontal=True)
        taken[max(road_y - margin - 46, 0) : road_y - margin + 46] = True
    if along:
        _road(ground, road_x, rng, horizontal=False)
        taken[:, max(road_x - margin - 46, 0) : road_x - margin + 46] = True
    if crossing:
        _yard(ground, margin + int(0.62 * shape[1]), margin + int(0.72 * shape[0]), rng)
        for n in rng.permutation(6)[: round(style.parked * area)]:
            color = CAR_COLORS[int(rng.integers(len(CAR_COLORS)))]
            x = margin + int((0.05 + 0.15 * n) * shape[1])
            _paste(ground, car(rng, color), x, road_y + 20)
    density = rows * cols / BASE_PIXELS / 1.6
    _trees(ground, round(style.trees * density), rng, avoid=(road_x, road_y))
    layers = []
    for n in range(math.ceil(style.houses * area)):
        size = int(rng.uniform(84, 110)), int(rng.uniform(104, 140))
        place = free_place(taken, size, rng)
        if place is None:
            continue
        x, y = place
        _shadow(ground, margin + x, margin + y, size[1], size[0])
        depth = float(rng.uniform(*style.roof_depth))
        layers.append(_roof(x, y, size[1], size[0], rng, f'house {n + 1}', depth))
    for n in range(math.ceil(style.crowns * area)):
        radius = int(rng.uniform(10, 22))
        place = free_place(taken, (2 * radius + 8, 2 * radius + 8), rng)
        if place is not None:
            depth = float(rng.uniform(*style.crown_depth))
            layers.append(_crown(*place, radius, rng, f'tree {n + 1}', depth))
    layers.sort(key=lambda layer: -layer.relative_depth)  # the nearest hide all others
    return Scene(ground, margin, tuple(layers))


def free_place(
    taken: np.ndarray, size: tuple[int, int], rng: np.random.Generator, gap: int = 12
) -> tuple[int, int] | None:
    """
    Find a free box and take it, with `gap` px around.

    Parameters
    ----------
    taken : ndarray of shape (M, N), bool
        Updated.
    size : tuple of int
        Rows and columns of the box [px].

    Returns
    -------
    tuple of int or None
        x, y of its upper left corner; None when some tries find none.

    """
    rows, cols = taken.shape
    for _ in range(60):
        y = int(rng.uniform(0.04 * rows, max(0.96 * rows - size[0], 0.05 * rows)))
        x = int(rng.uniform(0.04 * cols, max(0.96 * cols - size[1], 0.05 * cols)))
        box = taken[y : y + size[0], x : x + size[1]]
        if box.shape == size and not box.any():
            near = np.s_[max(y - gap, 0) : y + size[0] + gap, max(x - gap, 0) : x + size[1] + gap]
            taken[near] = True
            return x, y
    return None


def _noise(rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Sum of octaves of smooth noise, about -1..1."""
    total = np.zeros((rows, cols), np.float32)
    for cell, weight in ((128, 0.5), (40, 0.4), (14, 0.35), (5, 0.3), (2, 0.25)):
        coarse = rng.normal(0, 1, (rows // cell + 4, cols // cell + 4)).astype(np.float32)
        size = (coarse.shape[1] * cell, coarse.shape[0] * cell)
        total += weight * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)[:rows, :cols]
    return total


def _fields(rows: int, cols: int, texture: float, rng: np.random.Generator) -> np.ndarray:
    """Parcels of grass, crop and soil with their own grain and furrows."""
    colors = np.array([(70, 112, 96), (62, 96, 80), (96, 128, 138), (84, 118, 112)], np.float32)
    seeds = rng.uniform(0, 1, (9, 2)) * (cols, rows)
    y, x = np.mgrid[:rows, :cols].astype(np.float32)
    distance = [(x - sx) ** 2 + 1.4 * (y - sy) ** 2 for sx, sy in seeds]
    parcel = np.argmin(distance, axis=0)
    image = colors[parcel % len(colors)]
    angle = rng.uniform(0, np.pi, len(seeds))[parcel]
    furrows = np.sin((x * np.cos(angle) + y * np.sin(angle)) * 0.55) * (5.0 * (parcel % 3 == 1))
    mean = image.mean(axis=(0, 1))
    image = mean + min(1.0, 2 * texture) * (image - mean)
    image = image + texture * (24.0 * _noise(rows, cols, rng) + furrows)[..., None]
    return np.clip(image, 0, 255).astype(np.uint8)


def _road(image: np.ndarray, at: int, rng: np.random.Generator, horizontal: bool) -> None:
    """Draw a two-lane road across the image with lines, kerbs and worn asphalt."""
    view = image if horizontal else image.transpose(1, 0, 2)
    length = view.shape[1]
    strip = np.empty((84, length, 3), np.float32)
    strip[:] = GRAVEL
    strip[8:76] = ASPHALT
    strip[10:12] = strip[72:74] = LINE
    for x in range(0, length, 44):
        strip[41:43, x : x + 22] = LINE
    wear = 9.0 * _noise(84, length, rng)
    view[at - 42 : at + 42] = np.clip(strip + wear[..., None], 0, 255).astype(np.uint8)


def _yard(image: np.ndarray, x: int, y: int, rng: np.random.Generator) -> None:
    height, width = min(150, image.shape[0] - y), min(260, image.shape[1] - x)
    paving = np.empty((height, width, 3), np.float32)
    paving[:] = (136, 146, 152)
    paving[::18] -= 22
    paving[:, ::18] -= 22
    paving += 8.0 * _noise(height, width, rng)[..., None]
    image[y : y + height, x : x + width] = np.clip(paving, 0, 255).astype(np.uint8)


def _trees(image: np.ndarray, count: int, rng: np.random.Generator, avoid: tuple[int, int]) -> None:
    """Scatter crowns with a lit and a dark side; the two roads stay free."""
    rows, cols = image.shape[:2]
    for _ in range(count):
        x, y = int(rng.uniform(0, cols)), int(rng.uniform(0, rows))
        radius = int(rng.uniform(8, 19))
        if abs(x - avoid[0]) < 46 + radius or abs(y - avoid[1]) < 46 + radius:
            continue
        cv2.circle(image, (x + radius // 2, y + radius // 2), radius, (38, 52, 46), -1)
        for _ in range(26):
            angle, reach = rng.uniform(0, 2 * np.pi), radius * np.sqrt(rng.uniform(0, 1))
            dx, dy = reach * np.cos(angle), reach * np.sin(angle)
            lit = 26.0 * (-dx - dy) / radius + rng.normal(0, 10)
            color = tuple(float(np.clip(base + lit, 0, 255)) for base in (48, 86, 66))
            cv2.circle(image, (int(x + dx), int(y + dy)), max(2, radius // 4), color, -1)


def _shadow(image: np.ndarray, x: int, y: int, width: int, height: int) -> None:
    region = image[y + 10 : y + height + 16, x + 10 : x + width + 16]
    region[:] = (0.5 * region).astype(np.uint8)


def _roof(
    x: int, y: int, width: int, height: int, rng: np.random.Generator, name: str, depth: float
) -> Sheet:
    """Return a tiled gable roof with chimney and skylights."""
    texture = np.empty((height, width, 3), np.float32)
    tiles = np.array(ROOF_COLORS[int(rng.integers(len(ROOF_COLORS)))])
    texture[: height // 2] = tiles
    texture[height // 2 :] = 0.76 * tiles
    texture[::7] -= 24
    texture[:, ::9] -= 12
    texture += 7.0 * _noise(height, width, rng)[..., None]
    texture = np.clip(texture, 0, 255).astype(np.uint8)
    cv2.line(texture, (0, height // 2), (width, height // 2), (120, 130, 175), 2)
    cv2.rectangle(texture, (width // 5, 18), (width // 5 + 12, 30), (70, 70, 75), -1)
    for n in range(3):
        left = width // 3 + n * width // 5
        cv2.rectangle(texture, (left, height - 38), (left + 15, height - 18), (190, 170, 140), -1)
        cv2.rectangle(texture, (left, height - 38), (left + 15, height - 18), (60, 60, 60), 1)
    return Sheet(texture, rounded((height, width), 1), float(x), float(y), depth, name)


def _paste(image: np.ndarray, sheet: Sheet, x: int, y: int) -> None:
    height, width = sheet.cover.shape
    alpha = sheet.cover[..., None]
    region = image[y : y + height, x : x + width]
    region[:] = (region + alpha * (sheet.texture.astype(np.float32) - region)).astype(np.uint8)


def _crown(x: int, y: int, radius: int, rng: np.random.Generator, name: str, depth: float) -> Sheet:
    """Return a single tree with a ragged edge and a lit side."""
    size = 2 * radius + 8
    image = np.full((size, size, 3), (40, 62, 52), np.uint8)
    center = size / 2
    for _ in range(60):
        angle, reach = rng.uniform(0, 2 * np.pi), radius * np.sqrt(rng.uniform(0, 1))
        dx, dy = reach * np.cos(angle), reach * np.sin(angle)
        lit = 30.0 * (-dx - dy) / radius + rng.normal(0, 14)
        color = tuple(float(np.clip(base + lit, 0, 255)) for base in (46, 88, 66))
        cv2.circle(image, (int(center + dx), int(center + dy)), max(2, radius // 5), color, -1)
    return Sheet(image, soft_blob((size, size), rng, 0.2), float(x), float(y), depth, name)
