"""Pixels of a frame are found on its reference, and what was never judged is known."""

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.config import Config
from rsmb_ros.core.motion import Grid
from rsmb_ros.report.flight.ground import Coverage, Ground, focal_of


@pytest.fixture
def blank():
    return np.zeros((40, 48), np.uint8)


def test_every_row_is_mapped_by_its_own_pose(make, blank, bent_path):
    """As the path that the poses come from maps them."""
    grid: Grid = bent_path.grid
    result = replace(make(blank), row_motion=bent_path.row_motion())
    rng = np.random.default_rng(20170302)
    points = np.c_[rng.uniform(0, 47, 50), rng.integers(0, 40, 50)]
    mapped = Ground(result, grid.reference_shape, grid.focal_px).on_reference(points)
    for (x, y), found in zip(points, mapped, strict=True):
        h = bent_path.row_homographies()[int(y)]
        u, v, w = h @ (x - grid.center[0], y - grid.center[1], 1.0)
        np.testing.assert_allclose(found, grid.center[2:] + np.array([u, v]) / w, atol=1e-9)  # px


def test_rows_without_a_pose_are_nowhere(make, blank):
    result = make(blank)
    result.row_motion[10] = np.nan
    mapped = Ground(result, (40, 48), 50.0).on_reference(np.array([[5.0, 10], [5, 11]]))
    assert np.isnan(mapped[0]).all()
    np.testing.assert_allclose(mapped[1], (5, 11), atol=1e-9)


def test_what_no_frame_judged_is_left(make):
    image = np.zeros((80, 160), np.uint8)
    coverage = Coverage((80, 160))
    assert coverage.cell == 8
    coverage.add(Ground(make(image), (80, 160), 100.0), make(image, unknown_left=80).valid_mask)
    assert (coverage.judged == (np.arange(20) >= 10)).all()
    assert coverage.share == 0.5
    moved = make(image, shift=(-80.0, 0.0))  # looks at the left half only
    coverage.add(Ground(moved, (80, 160), 100.0), moved.valid_mask)
    assert coverage.share == 1.0


def test_coverage_has_no_holes_where_the_frame_is_coarser_than_the_reference(make):
    image = np.zeros((60, 80), np.uint8)
    near = make(image)
    near.row_motion[:, 3] = 2.0  # scale: one live pixel is two of the reference
    coverage = Coverage((120, 160))
    coverage.add(Ground(near, (120, 160), 80.0), near.valid_mask)
    assert coverage.share == 1.0


def test_focal_length_is_the_detectors(make):
    given = Config.from_mapping({'camera.focal_px': 300.0})
    assert focal_of(given, Camera(200.0), 640) == 300.0
    assert focal_of(Config(), Camera(200.0), 640) == 200.0
    assert focal_of(Config(), None, 640) == Camera.guess(640).focal_px
