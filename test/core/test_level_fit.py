"""Steps of the path's fit: none may lead away from what was reached."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Detector
from rsmb_ros.core._kernels.fit_row import EXTRA
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.path_fit import PathFit, row_uncertainty
from rsmb_ros.core.photometric import Light

SHAPE = (360, 480)
OFF = ((8, -1), (8, 2), (-5, -6))  # px
MARGIN = 24  # px


@pytest.fixture(scope='module')
def ground():
    """Return a ground that says nothing at small sizes: noise of few pixels."""
    rng = np.random.default_rng(20170304)
    noise = cv2.GaussianBlur(rng.normal(size=np.add(SHAPE, 2 * MARGIN)), (0, 0), 2.0)
    grey = 128 + 45 * noise / noise.std()
    return np.clip(grey[..., None] * [0.9, 1.0, 1.05], 0, 255).astype(np.uint8)


def view(ground, y, x):
    return ground[MARGIN + y :, MARGIN + x :][: SHAPE[0], : SHAPE[1]]


@pytest.mark.parametrize('off', OFF)
def test_a_sharp_frame_of_fine_texture_needs_one_start(ground, off):
    # nothing tells how long it was exposed; a long exposure once let the path oscillate within it
    result = Detector(view(ground, 0, 0)).detect(view(ground, *off))
    assert result.status == 'registered'
    assert 'second start' not in result.timings_ms
    middle = result.row_motion[20:-20, :2]
    assert np.allclose(middle, off[::-1], atol=0.05)


@pytest.mark.oracle
def test_uncertainty_of_a_row_is_that_of_its_place():
    rng = np.random.default_rng(7)
    path = still_path(Grid((48, 64), (48, 64), 60.0), 8.0, 9.0, 16.0, bottom_up=False)
    size = len(path.control) * 6 + EXTRA
    rows = rng.normal(size=(4 * size, size))
    fit = PathFit(path, Light.same(), 0.0, 1.0, 1.0, np.tril(rows.T @ rows), 1.0)
    covariance = np.linalg.inv(rows.T @ rows)
    basis = path.spline_basis(path.row_times)
    parts = [covariance[e : size - EXTRA : 6, e : size - EXTRA : 6] for e in (0, 1)]
    variance = sum(np.einsum('tk,kl,tl->t', basis, part, basis) for part in parts)
    np.testing.assert_allclose(row_uncertainty(fit), np.sqrt(variance), rtol=1e-9)
    unknown = replace(fit, information=np.zeros((size, size)))
    assert np.isinf(row_uncertainty(unknown)).all()
