"""Drawn objects that come, go and move, and their shadows."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from .scene import GONE, NEW, Sheet

CAR_COLORS = ((60, 60, 190), (190, 190, 195), (70, 60, 55), (150, 105, 60), (235, 235, 235))
SHADOW_SHIFT = 0.22  # of the object's smaller side, to the lower right


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
    return Sheet(grained(texture, 4.0, rng), rounded(texture.shape[:2], 5), 0.0, 0.0)


def container(rng: np.random.Generator) -> Sheet:
    """Return a freight container of 74 x 32 px, at (0, 0)."""
    texture = np.empty((32, 74, 3), np.uint8)
    texture[:] = (165, 110, 50)
    texture[:, ::6] = (125, 80, 35)
    texture[:, 1::6] = (190, 140, 85)
    cv2.rectangle(texture, (26, 11), (48, 20), (225, 225, 225), -1)
    return Sheet(grained(texture, 4.0, rng), rounded(texture.shape[:2], 1), 0.0, 0.0)


def rounded(shape: tuple[int, int], radius: int) -> np.ndarray:
    """Alpha of a rectangle with rounded corners and a soft edge."""
    cover = np.ones(shape, np.uint8)
    corner = np.zeros((2 * radius + 1,) * 2, np.uint8)
    cv2.circle(corner, (radius, radius), radius, 1, -1)
    padded = cv2.copyMakeBorder(cover, *[radius + 1] * 4, cv2.BORDER_CONSTANT, value=0)
    rounded = cv2.morphologyEx(padded, cv2.MORPH_OPEN, corner).astype(np.float32)
    soft = cv2.GaussianBlur(rounded, (3, 3), 0.6)
    return soft[radius + 1 : -radius - 1, radius + 1 : -radius - 1]


def grained(texture: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    grain = rng.normal(0, sigma, texture.shape[:2])[..., None]
    return np.clip(texture + grain, 0, 255).astype(np.uint8)


def tarpaulin(rng: np.random.Generator, size: tuple[int, int]) -> Sheet:
    """Return a plain patch with an irregular outline, `size` rows and columns [px]."""
    texture = np.empty((*size, 3), np.uint8)
    color = rng.uniform(30, 225) + rng.normal(0, 22, 3)
    texture[:] = np.clip(color, 10, 245)
    return Sheet(grained(texture, 2.0, rng), soft_blob(size, rng, 0.12), 0.0, 0.0)


def rubble(rng: np.random.Generator, size: tuple[int, int]) -> Sheet:
    """Return a heap of stones with an irregular outline, `size` rows and columns [px]."""
    texture = np.empty((*size, 3), np.uint8)
    texture[:] = (88, 92, 98)
    for _ in range(size[0] * size[1] // 12):
        x, y = int(rng.integers(size[1])), int(rng.integers(size[0]))
        value = float(rng.uniform(50, 200))
        cv2.circle(texture, (x, y), int(rng.integers(1, 4)), (value, value, value), -1)
    return Sheet(texture, soft_blob(size, rng, 0.15), 0.0, 0.0)


def any_object(rng: np.random.Generator) -> Sheet:
    """Return a car, a container, a tarpaulin or a heap, turned by some quarter, at (0, 0)."""
    kind = int(rng.integers(4))
    size = int(rng.uniform(16, 56)), int(rng.uniform(18, 72))
    if kind == 0:
        sheet = car(rng, CAR_COLORS[int(rng.integers(len(CAR_COLORS)))])
    elif kind == 1:
        sheet = container(rng)
    else:
        sheet = (tarpaulin if kind == 2 else rubble)(rng, size)
    turns = int(rng.integers(4))
    texture = np.ascontiguousarray(np.rot90(sheet.texture, turns))
    return replace(sheet, texture=texture, cover=np.ascontiguousarray(np.rot90(sheet.cover, turns)))


def enlarged(sheet: Sheet, zoom: float) -> Sheet:
    """Return the sheet with `zoom` times its size, for frames of more pixels."""
    if zoom == 1.0:
        return sheet
    texture = cv2.resize(sheet.texture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_LINEAR)
    return replace(sheet, texture=texture, cover=cv2.resize(sheet.cover, texture.shape[1::-1]))


def cast_shadow(sheet: Sheet, strength: float) -> Sheet:
    """Return the shadow an object casts beside itself, taking `strength` (0..1) of the light."""
    shift = max(2, round(SHADOW_SHIFT * min(sheet.cover.shape)))
    cover = np.zeros((sheet.cover.shape[0] + 8, sheet.cover.shape[1] + 8), np.float32)
    cover[4:-4, 4:-4] = strength * np.clip(sheet.cover, 0, 1)
    cover = cv2.GaussianBlur(cover, (0, 0), 1.2)
    return replace(
        sheet,
        texture=np.zeros((*cover.shape, *sheet.texture.shape[2:]), np.uint8),
        cover=cover,
        x=sheet.x - 4 + shift,
        y=sheet.y - 4 + shift,
        name=f'shadow of {sheet.name}',
        shadow=True,
    )


def appearing(sheet: Sheet, x: float, y: float, name: str, kind: int = NEW) -> Sheet:
    """Return the sheet at a place of the reference [px], `NEW` or `GONE`."""
    assert kind in (NEW, GONE)
    return replace(sheet, x=float(round(x)), y=float(round(y)), name=name, kind=kind)


def soft_blob(size: tuple[int, int], rng: np.random.Generator, roughness: float) -> np.ndarray:
    """Alpha of an ellipse with an irregular, soft outline, `size` rows and columns [px]."""
    rows, cols = size
    y, x = np.mgrid[:rows, :cols].astype(np.float32)
    y, x = (y - (rows - 1) / 2) / (rows / 2), (x - (cols - 1) / 2) / (cols / 2)
    angle = np.arctan2(y, x)
    waves = sum(
        rng.normal(0, roughness / n) * np.cos(n * angle + rng.uniform(0, 2 * np.pi))
        for n in range(2, 7)
    )
    edge = np.clip(0.88 * (1.0 + waves), 0.45, 0.96)
    softness = 2.0 / min(rows, cols)
    return np.clip((edge - np.hypot(x, y)) / softness + 0.5, 0.0, 1.0).astype(np.float32)
