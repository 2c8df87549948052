"""Ringaby and Forssen: motion at key rows."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsmb_ros.evaluation.rivals.features import Pairs
from rsmb_ros.evaluation.rivals.ringaby import (
    Planar,
    RingabyRegistrar,
    Rotations,
    fitted_motion,
)
from rsmb_ros.evaluation.warping import mapped

FOCAL = 0.9 * 320
CENTRE = np.array([159.5, 119.5])


def turned(row_time):
    """Row homographies K R(row) K^-1 of a camera that turns smoothly about all axes."""
    vectors = np.stack(
        [
            5 / FOCAL * np.sin(4 * row_time),
            6 / FOCAL * np.sin(3.5 * row_time + 1),
            0.02 * np.cos(3 * row_time),
        ],
        axis=1,
    )
    k = np.array([[FOCAL, 0, CENTRE[0]], [0, FOCAL, CENTRE[1]], [0, 0, 1]])
    return k @ Rotation.from_rotvec(vectors).as_matrix() @ np.linalg.inv(k)


@pytest.mark.parametrize('focal_px', [None, FOCAL])
def test_rotations_are_found(focal_px, reference, row_time, places_under, taken, place_error):
    places = places_under(turned(row_time))
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    found = RingabyRegistrar().register(*pair, focal_px)
    assert place_error(found, places) < 0.2  # px, linear between 8 key rows


def test_planar_motion_is_found(reference, row_time, moved_rows, taken, place_error):
    places = moved_rows(
        5 * np.sin(4 * row_time), 4 * np.cos(4 * row_time), 0.03 * np.sin(3 * row_time)
    )
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    found = RingabyRegistrar('ringaby-planar', planar=True).register(*pair, None)
    assert place_error(found, places) < 0.2  # px, linear between 8 key rows


MODELS = [Rotations(FOCAL, CENTRE, CENTRE + 10), Planar(160.0, CENTRE, CENTRE + 10)]


@pytest.mark.parametrize('model', MODELS, ids=['rotations', 'planar'])
def test_a_still_camera_maps_centre_to_centre(model):
    keys = np.array([0.0, 239.0])
    hs = model.homographies(keys, np.zeros((2, 3)), np.array([0.0, 100, 239]))
    found = mapped(hs, np.array([0.0, 5, 9]), np.array([3.0, 100, 239]))
    np.testing.assert_allclose(found, np.array([[10, 13], [15, 110], [19, 249]]), atol=1e-9)


@pytest.mark.parametrize('model', MODELS, ids=['rotations', 'planar'])
def test_a_unit_of_motion_moves_pixels_by_about_a_pixel(model):
    keys = np.array([0.0, 239.0])
    still = model.homographies(keys, np.zeros((2, 3)), np.array([120.0]))
    for axis in range(3):
        motion = np.zeros((2, 3))
        motion[:, axis] = 1
        step = mapped(model.homographies(keys, motion, np.array([120.0])), 319.0, 120.0)
        assert 0.3 < np.linalg.norm(step - mapped(still, 319.0, 120.0)) < 2.0


@pytest.mark.parametrize('model', MODELS, ids=['rotations', 'planar'])
def test_motion_is_recovered_among_wrong_tracks(model):
    rng = np.random.default_rng(4)
    keys = np.linspace(0, 239, 6)
    motion = rng.normal(0, 4, (6, 3))
    live = rng.uniform([0, 0], [319, 239], (500, 2))
    seen = mapped(model.homographies(keys, motion, live[:, 1]), *live.T)
    seen[:100] += rng.uniform(-30, 30, (100, 2))
    found = fitted_motion(model, Pairs(live, seen), keys)
    assert np.abs(found - motion).max() < 0.2  # px; at the ends few tracks decide
