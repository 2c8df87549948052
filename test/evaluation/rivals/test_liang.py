"""Liang et al.: translations along a Bezier curve over the rows."""

import numpy as np
import pytest

from rsmb_ros.evaluation.methods import NotRegistered
from rsmb_ros.evaluation.rivals.features import HomographyRegistrar
from rsmb_ros.evaluation.rivals.liang import (
    BlockMotions,
    LiangRegistrar,
    bezier,
    dominant_motions,
    fitted_bezier,
    sub_pixel_peak,
)


def test_uniform_motion_is_found(reference, row_time, moved_rows, taken, place_error):
    places = moved_rows(12 * row_time - 3, 2 - 5 * row_time)
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    assert place_error(LiangRegistrar().register(*pair, None), places) < 0.1  # px


def test_nonuniform_motion_is_found_better_than_by_a_homography(
    reference, row_time, moved_rows, taken, place_error
):
    places = moved_rows(8 * np.sin(4 * row_time), 4 * np.cos(4 * row_time))
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    liang = place_error(LiangRegistrar().register(*pair, None), places)
    stiff = place_error(HomographyRegistrar('orb').register(*pair, None), places)
    assert liang < min(0.3, stiff / 3)  # px; the sine is not quite a cubic


def test_a_turn_is_beyond_its_model(reference, moved_rows, taken, place_error):
    places = moved_rows(np.zeros(240), np.zeros(240), np.full(240, 0.03))
    pair = reference.astype(np.float32), taken(reference, places).astype(np.float32)
    # 0.03 rad move a pixel 80 px beside the centre by 2.4 px
    assert place_error(LiangRegistrar().register(*pair, None), places) > 1.0


def test_a_bezier_curve_goes_through_its_shifts():
    t = np.linspace(0.1, 0.9, 12)
    control = np.array([[0, 1], [3, 1], [-2, 5], [4, 4.0]])
    np.testing.assert_allclose(fitted_bezier(t, bezier(control, t)), control, atol=1e-6)


def test_one_wrong_band_hardly_bends_the_curve():
    t = np.linspace(0.0, 1.0, 20)
    control = np.array([[0, 1], [3, 1], [-2, 5], [4, 4.0]])
    shifts = bezier(control, t)
    shifts[7] += 30
    error = bezier(fitted_bezier(t, shifts), t) - bezier(control, t)
    assert np.abs(error).max() < 0.3  # px; least squares: 4


def test_a_parabola_has_its_peak_between_pixels():
    y, x = np.mgrid[:7, :9]
    scores = 0.9 - 0.02 * ((x - 4.3) ** 2 + (y - 2.8) ** 2)
    np.testing.assert_allclose(sub_pixel_peak(scores), [4.3, 2.8], atol=1e-9)


@pytest.mark.parametrize('place', [(0, 3), (3, 0), (6, 3), (3, 8)])
def test_a_peak_at_the_rim_is_none(place):
    scores = np.zeros((7, 9))
    scores[place] = 0.9
    assert np.isnan(sub_pixel_peak(scores)).all()


def test_a_low_peak_is_none():
    scores = np.zeros((7, 9))
    scores[3, 3] = 0.5
    assert np.isnan(sub_pixel_peak(scores)).all()


def test_the_dominant_motion_of_a_band_is_its_median():
    rows = np.repeat(np.arange(8.0), 5)
    shift = np.tile(np.array([[1, 2], [1, 2], [1, 2], [9, 9], [np.nan, np.nan]]), (8, 1))
    bands, motions = dominant_motions(BlockMotions(rows, shift))
    np.testing.assert_array_equal(bands, np.arange(8))
    np.testing.assert_array_equal(motions, np.tile([1, 2], (8, 1)))


def test_few_found_blocks_are_refused():
    shift = np.full((100, 2), np.nan)
    shift[:35] = 1.0
    motions = BlockMotions(np.tile(np.arange(10.0), 10), shift)
    with pytest.raises(NotRegistered, match='35 of 100 blocks matched in 10 bands, need 40 in 6'):
        dominant_motions(motions)
