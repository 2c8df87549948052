"""The motion of the rows is drawn where its numbers are."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.report.flight.row_plot import row_plot


@pytest.fixture
def moving(make):
    """A frame whose rows move by a sine of 5 px and turn by a tenth of a degree."""
    result = make(np.zeros((200, 100), np.uint8))
    rows = np.arange(200)
    result.row_motion[:, 0] = 12 + 5 * np.sin(rows / 20)
    result.row_motion[:, 2] = np.linspace(-0.05, 0.05, 200)
    return replace(result, row_uncertainty=np.full(200, 0.5))


def points(path):
    return np.array([[float(v) for v in pair.split()] for pair in re.split('[ML]', path)[1:]])


def value_at(panel, height):
    """Read a height with the help of the numbers at the axis."""
    (y0, text0), (y1, text1) = panel.marks[0], panel.marks[-1]
    low, high = (float(text.replace('\N{MINUS SIGN}', '-')) for text in (text0, text1))
    return low + (height - y0) * (high - low) / (y1 - y0)


def test_curve_has_the_values_of_its_rows(moving):
    plot = row_plot(moving)
    panel = plot.panels[0]
    curve = points(panel.curve)
    rows = (curve[:, 0] - plot.left) / (plot.right - plot.left) * 199
    expected = 12 + 5 * np.sin(np.rint(rows) / 20)
    np.testing.assert_allclose(value_at(panel, curve[:, 1]), expected, atol=0.02)  # 0.1 px drawn
    assert curve[:, 1].min() >= panel.top
    assert curve[:, 1].max() <= panel.bottom


def test_band_is_two_standard_deviations_high(moving):
    plot = row_plot(moving)
    for panel in plot.panels[:2]:
        there, back = np.split(points(panel.band.removesuffix('Z')), 2)
        middle = slice(30, 130)  # at its ends the axis may cut it off
        low, high = value_at(panel, there[middle, 1]), value_at(panel, back[::-1][middle, 1])
        np.testing.assert_allclose(high - low, 4 * 0.5, atol=0.05)  # 0.1 px drawn


def test_still_camera_is_a_flat_line(make):
    plot = row_plot(make(np.zeros((50, 60), np.uint8)))
    for panel in plot.panels:
        assert np.ptp(points(panel.curve)[:, 1]) == 0


def test_rows_without_a_pose_interrupt_the_curve(moving):
    moving.row_motion[80:120] = np.nan
    assert row_plot(moving).panels[0].curve.count('M') == 2


def test_exposure_has_the_length_of_its_rows(moving):
    plot = row_plot(moving)
    left, width, text = plot.exposure
    assert text == 'exposure 42 rows'
    assert width == pytest.approx(42 / 199 * (plot.right - plot.left))
    assert left == plot.left
    assert row_plot(replace(moving, exposure_rows=float('nan'))).exposure is None


def test_it_can_be_read_aloud(moving):
    assert 't_x 7.00 to 17.00 px' in row_plot(moving).description
