"""Procedural aerial scenes: fields, roads, trees, cars, houses at another depth, new objects."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .synthesis import Scene, Sheet

ROOF_DEPTH = 0.88  # relative depth of the roofs: 12 % of the flying height above the ground
ASPHALT, GRAVEL, LINE = (92, 94, 96), (126, 140, 150), (205, 210, 212)  # BGR
CAR_COLORS = ((60, 60, 190), (190, 190, 195), (70, 60, 55), (150, 105, 60), (235, 235, 235))


@dataclass(frozen=True)
class AerialScene:
    """A scene and the objects that may appear in it."""

    scene: Scene
    objects: tuple[Sheet, ...]  # at places where they make sense, named


def aerial_scene(shape: tuple[int, int], rng: np.random.Generator, margin: int = 80) -> AerialScene:
    """
    Draw a suburb seen from above, in colour.

    Parameters
    ----------
    shape : tuple of int
        Rows and columns of the reference [px]; laid out for about 480 x 640.
    rng : numpy.random.Generator
        Equal seeds give equal scenes.
    margin : int
        Ground drawn beyond each edge of the reference [px].

    """
    rows, cols = shape[0] + 2 * margin, shape[1] + 2 * margin
    ground = _fields(rows, cols, rng)
    road_y = margin + int(0.58 * shape[0])
    road_x = margin + int(0.36 * shape[1])
    _road(ground, road_y, rng, horizontal=True)
    _road(ground, road_x, rng, horizontal=False)
    yard = (margin + int(0.62 * shape[1]), margin + int(0.72 * shape[0]))
    _yard(ground, *yard, rng)
    _trees(ground, 46, rng, avoid=(road_x, road_y))
    for n, share in enumerate((0.08, 0.22, 0.83)):
        _paste(ground, car(rng, CAR_COLORS[n + 2]), margin + int(share * shape[1]), road_y + 20)
    roofs = []
    for n, (x, y, width, height) in enumerate(_plots(shape)):
        _shadow(ground, margin + x, margin + y, width, height)
        roofs.append(_roof(x, y, width, height, rng, name=f'house {n + 1}'))
    objects = (
        _named(car(rng, CAR_COLORS[0]), 'car', 0.68 * shape[1], 0.58 * shape[0] - 32),
        _named(container(rng), 'container', yard[0] - margin + 30, yard[1] - margin + 24),
    )
    return AerialScene(Scene(ground, margin, tuple(roofs)), objects)


def car(rng: np.random.Generator, color: tuple[int, int, int]) -> Sheet:
    """Return a car of about 46 x 22 px heading right, at (0, 0)."""
    texture = np.empty((22, 46, 3), np.uint8)
    texture[:] = color
    dark = (45, 40, 38)
    cv2.rectangle(texture, (30, 3), (36, 18), dark, -1)  # wind screen
    cv2.rectangle(texture, (7, 4), (11, 17), dark, -1)
    cv2.rectangle(texture, (15, 2), (27, 3), dark, -1)
    cv2.rectangle(texture, (15, 18), (27, 19), dark, -1)
    light = tuple(int(0.6 * value + 100) for value in color)
    cv2.rectangle(texture, (14, 5), (28, 16), light, -1)
    return Sheet(_grained(texture, 4.0, rng), _rounded(texture.shape[:2], 5), 0.0, 0.0)


def container(rng: np.random.Generator) -> Sheet:
    """Return a freight container of 74 x 32 px, at (0, 0)."""
    texture = np.empty((32, 74, 3), np.uint8)
    texture[:] = (165, 110, 50)
    texture[:, ::6] = (125, 80, 35)
    texture[:, 1::6] = (190, 140, 85)
    cv2.rectangle(texture, (26, 11), (48, 20), (225, 225, 225), -1)
    return Sheet(_grained(texture, 4.0, rng), _rounded(texture.shape[:2], 1), 0.0, 0.0)


def pasted_object(shape: tuple[int, int], rng: np.random.Generator) -> Sheet:
    """Return one car or container somewhere inside a reference of `shape`, sized to it."""
    sheet = (container(rng), car(rng, CAR_COLORS[int(rng.integers(len(CAR_COLORS)))]))[
        int(rng.integers(2))
    ]
    zoom = max(1.0, shape[1] / 640.0)
    texture = cv2.resize(sheet.texture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
    cover = cv2.resize(sheet.cover, (texture.shape[1], texture.shape[0]))
    x = rng.uniform(0.2, 0.75) * shape[1]
    y = rng.uniform(0.2, 0.75) * shape[0]
    return Sheet(texture, cover, float(round(x)), float(round(y)))


def _plots(shape: tuple[int, int]) -> list[tuple[int, int, int, int]]:
    rows, cols = shape
    return [
        (int(0.64 * cols), int(0.09 * rows), 132, 104),
        (int(0.07 * cols), int(0.72 * rows), 108, 84),
    ]


def _noise(rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Sum of octaves of smooth noise, about -1..1."""
    total = np.zeros((rows, cols), np.float32)
    for cell, weight in ((128, 0.5), (40, 0.4), (14, 0.35), (5, 0.3), (2, 0.25)):
        coarse = rng.normal(0, 1, (rows // cell + 4, cols // cell + 4)).astype(np.float32)
        size = (coarse.shape[1] * cell, coarse.shape[0] * cell)
        total += weight * cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)[:rows, :cols]
    return total


def _fields(rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Parcels of grass, crop and soil with their own grain and furrows."""
    colors = np.array([(70, 112, 96), (62, 96, 80), (96, 128, 138), (84, 118, 112)], np.float32)
    seeds = rng.uniform(0, 1, (9, 2)) * (cols, rows)
    y, x = np.mgrid[:rows, :cols].astype(np.float32)
    distance = [(x - sx) ** 2 + 1.4 * (y - sy) ** 2 for sx, sy in seeds]
    parcel = np.argmin(distance, axis=0)
    image = colors[parcel % len(colors)]
    angle = rng.uniform(0, np.pi, len(seeds))[parcel]
    furrows = np.sin((x * np.cos(angle) + y * np.sin(angle)) * 0.55) * (5.0 * (parcel % 3 == 1))
    image = image + (24.0 * _noise(rows, cols, rng) + furrows)[..., None]
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


def _roof(x: int, y: int, width: int, height: int, rng: np.random.Generator, name: str) -> Sheet:
    """Return a tiled gable roof with chimney and skylights, at the height of `ROOF_DEPTH`."""
    texture = np.empty((height, width, 3), np.float32)
    texture[: height // 2] = (82, 98, 158)
    texture[height // 2 :] = (62, 74, 124)
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
    return Sheet(texture, _rounded((height, width), 1), float(x), float(y), ROOF_DEPTH, name)


def _paste(image: np.ndarray, sheet: Sheet, x: int, y: int) -> None:
    height, width = sheet.cover.shape
    alpha = sheet.cover[..., None]
    region = image[y : y + height, x : x + width]
    region[:] = (region + alpha * (sheet.texture.astype(np.float32) - region)).astype(np.uint8)


def _named(sheet: Sheet, name: str, x: float, y: float) -> Sheet:
    return Sheet(sheet.texture, sheet.cover, float(round(x)), float(round(y)), 1.0, name)


def _rounded(shape: tuple[int, int], radius: int) -> np.ndarray:
    """Alpha of a rectangle with rounded corners and a soft edge."""
    cover = np.ones(shape, np.uint8)
    corner = np.zeros((2 * radius + 1,) * 2, np.uint8)
    cv2.circle(corner, (radius, radius), radius, 1, -1)
    padded = cv2.copyMakeBorder(cover, *[radius + 1] * 4, cv2.BORDER_CONSTANT, value=0)
    rounded = cv2.morphologyEx(padded, cv2.MORPH_OPEN, corner).astype(np.float32)
    soft = cv2.GaussianBlur(rounded, (3, 3), 0.6)
    return soft[radius + 1 : -radius - 1, radius + 1 : -radius - 1]


def _grained(texture: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    grain = rng.normal(0, sigma, texture.shape[:2])[..., None]
    return np.clip(texture + grain, 0, 255).astype(np.uint8)
