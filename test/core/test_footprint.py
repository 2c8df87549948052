"""From live frame to reference and back, where every row has a pose of its own."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core.footprint import judged_at, on_reference, overlap
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.segmentation import Blob


def mapped_pixels(blob, path):
    """Reference places x, y of each pixel of a blob, literally (n, 2)."""
    live_x, live_y, reference_x, reference_y = path.grid.center
    homographies = path.row_homographies()
    places = []
    for row, column in np.argwhere(blob.mask) + np.array([blob.y, blob.x]):
        u, v, w = homographies[row] @ (column - live_x, row - live_y, 1.0)
        places.append((u / w + reference_x, v / w + reference_y))
    return np.array(places)


@pytest.fixture
def blob():
    mask = np.ones((9, 12), bool)
    mask[:4, :5] = False  # an L
    return Blob(mask, 20, 15)


def test_footprint_is_where_the_rows_of_a_bent_frame_lie(bent_path, blob):
    place = on_reference(blob, bent_path.row_homographies(), bent_path.grid)
    points = mapped_pixels(blob, bent_path)
    columns, rows = np.rint(points).astype(int).T
    inside = place.mask[rows - place.y, columns - place.x]
    assert inside.all()
    assert abs(place.area - blob.area) < 0.2 * blob.area  # px: rounding of an outline of 42
    y, x = np.argwhere(place.mask).mean(axis=0)
    np.testing.assert_allclose((x + place.x, y + place.y), points.mean(axis=0), atol=0.5)


def test_footprint_on_a_finer_reference_has_no_gaps(blob):
    path = still_path(Grid((40, 48), (160, 192), 60.0), 8.0, 2.0, 16.0, bottom_up=False)
    path.control[:, 3] = 3 * path.grid.half_width  # zeta: the reference shows it 4 times as large
    place = on_reference(blob, path.row_homographies(), path.grid)
    # between the centres of the outermost pixels
    full = (4 * 11 + 1) * (4 * 8 + 1) - 4 * 5 * 4 * 4
    assert 0 <= place.area - full <= 6  # px: the outline cuts its inner corner by half a live one


def test_what_a_bent_frame_judges_is_found_again_from_the_reference(bent_path):
    rng = np.random.default_rng(3)
    judged = rng.random((40, 48)) < 0.5
    everything = Blob(np.ones((40, 48), bool), 0, 0)
    points = mapped_pixels(everything, bent_path)
    known = judged_at(points, bent_path.row_homographies(), bent_path.grid, judged)
    # a point between two rows may fall to either
    assert (known == judged.ravel()).mean() > 0.97


def test_what_a_frame_does_not_show_is_not_judged():
    path = still_path(Grid((40, 48), (40, 48), 60.0), 8.0, 2.0, 16.0, bottom_up=False)
    path.control[:, 0] = 10.0  # px: the frame lies that far right
    points = np.array([[9.0, 20.0], [10.0, 20.0], [47.0, 20.0], [20.0, 39.0], [20.0, 40.0]])
    known = judged_at(points, path.row_homographies(), path.grid, np.ones((40, 48), bool))
    np.testing.assert_array_equal(known, [False, True, True, True, False])


def test_overlap_counts_common_pixels(blob):
    other = Blob(np.ones((3, 6), bool), 22, 17)
    common = sum(
        blob.mask[row - 15, column - 20] for row in range(17, 20) for column in range(22, 28)
    )
    assert overlap(blob, other) == overlap(other, blob) == common == 12
    assert overlap(blob, Blob(np.ones((3, 6), bool), 32, 17)) == 0
