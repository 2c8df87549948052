"""Shared fixtures: small textured images and paths, all with fixed seeds."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.workers import Workers


def textured(rows: int, cols: int, seed: int) -> np.ndarray:
    """Smooth random texture with structure at several scales, uint8."""
    rng = np.random.default_rng(seed)
    image = np.full((rows, cols), 120.0, np.float32)
    for cell, weight in ((32, 25), (12, 22), (5, 18)):
        coarse = rng.normal(0, weight, (rows // cell + 4, cols // cell + 4)).astype(np.float32)
        size = (coarse.shape[1] * cell, coarse.shape[0] * cell)
        image += cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)[:rows, :cols]
    return np.clip(image, 5, 250).astype(np.uint8)


@pytest.fixture(scope='session')
def texture_of():
    """Return the maker of textures: ``texture_of(rows, cols, seed)``."""
    return textured


@pytest.fixture(scope='session')
def executor():
    """Two threads, as the detector has."""
    with Workers(2) as pool:
        yield pool


@pytest.fixture
def bent_path():
    """A path that bends, turns, zooms and tilts over a 40 x 48 px frame, blurred over 9 rows."""
    rng = np.random.default_rng(20170301)
    path = still_path(Grid((40, 48), (44, 52), 60.0), 8.0, 9.0, 16.0, bottom_up=False)
    path.control[:] = rng.normal(0, [1.5, 1.5, 0.8, 0.6, 0.4, 0.4], path.control.shape)
    return path


@pytest.fixture(scope='session')
def real_photos():
    """Folder of real aerial photos; skips where they are absent."""
    root = Path(os.environ.get('RSMB_DATA', Path(__file__).parents[1] / '../shared/data'))
    if not (root / 'aerial').is_dir():
        pytest.skip(f'no real photos at {root} (set RSMB_DATA)')
    return root / 'aerial'
