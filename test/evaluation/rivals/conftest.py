"""Pairs with known places: textures warped by plain code of the tests' own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

SHAPE = (240, 320)


@pytest.fixture(scope='session')
def reference(texture_of):
    """Textured reference of 240 x 320 px."""
    return texture_of(*SHAPE, 1)


@pytest.fixture(scope='session')
def row_time():
    """Time of each row of a live frame, 0..1."""
    return np.linspace(0.0, 1.0, SHAPE[0])


@pytest.fixture(scope='session')
def places_under():
    """Return the maker of places (M, N, 2) from a homography per row (M, 3, 3)."""

    def make(hs: np.ndarray, cols: int = SHAPE[1]) -> np.ndarray:
        x = np.arange(cols, dtype=np.float64)
        places = []
        for y, h in enumerate(hs):
            u, v, w = h @ np.stack([x, np.full(cols, float(y)), np.ones(cols)])
            places.append(np.stack([u / w, v / w], axis=1))
        return np.array(places)

    return make


@pytest.fixture(scope='session')
def moved_rows(places_under):
    """Return the maker of places from t_x, t_y [px] and turn [rad] of each row."""

    def make(t_x, t_y, turn=None, cols: int = SHAPE[1]) -> np.ndarray:
        rows = len(t_x)
        turn = np.zeros(rows) if turn is None else turn
        c_x, c_y = (cols - 1) / 2, (rows - 1) / 2
        cos, sin = np.cos(turn), np.sin(turn)
        hs = np.zeros((rows, 3, 3))
        hs[:, 0] = np.stack([cos, -sin, c_x + t_x - cos * c_x + sin * c_y], axis=1)
        hs[:, 1] = np.stack([sin, cos, c_y + t_y - sin * c_x - cos * c_y], axis=1)
        hs[:, 2, 2] = 1
        return places_under(hs, cols)

    return make


@pytest.fixture(scope='session')
def taken():
    """Return the camera: ``taken(reference, places)`` is a sharp frame, uint8, noise of 1 level."""

    def make(reference: np.ndarray, places: np.ndarray, noise: float = 1.0) -> np.ndarray:
        maps = places.astype(np.float32)
        sharp = cv2.remap(reference, maps, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        grain = np.random.default_rng(7).normal(0, noise, sharp.shape)
        return np.clip(np.rint(sharp + grain), 0, 255).astype(np.uint8)

    return make


@pytest.fixture(scope='session')
def place_error():
    """Return the measure: median distance of the places found from the true ones [px]."""

    def measure(registration, places: np.ndarray) -> float:
        error = np.linalg.norm(registration.places - places, axis=2)
        return float(np.median(error[registration.inside]))

    return measure


@pytest.fixture(scope='session')
def homography():
    """Tilt, turn, zoom and shift of a whole frame, live pixel -> reference pixel."""
    return np.array([[1.01, 0.03, -7.0], [-0.025, 0.99, 9.0], [2e-5, -1e-5, 1.0]])


@pytest.fixture(scope='session')
def homography_places(homography, places_under):
    """Places under `homography`."""
    return places_under(np.broadcast_to(homography, (SHAPE[0], 3, 3)))


@pytest.fixture(scope='session')
def homography_pair(reference, homography_places, taken):
    """Reference and live frame under one homography, float32."""
    live = taken(reference, homography_places)
    return reference.astype(np.float32), live.astype(np.float32)
