"""Curves and axes as SVG."""

import numpy as np
import pytest

from rsmb_ros.report.shapes import band, bars, line, ticks


@pytest.mark.parametrize(
    ('low', 'high', 'found'),
    [
        (0, 479, [0, 200, 400]),
        (-0.46, -0.29, [-0.4, -0.3]),
        (14.2, 22.9, [15, 20]),
        (-24.1, -15.2, [-24, -22, -20, -18, -16]),
        (-1e-3, 1e-3, [-0.001, 0, 0.001]),
    ],
)
def test_ticks_are_round_and_inside(low, high, found):
    marks = ticks(low, high)
    assert all(low <= mark <= high for mark in marks)
    assert 2 <= len(marks) <= 6
    assert marks == pytest.approx(found)


def test_line_is_interrupted_where_nothing_is_known():
    y = np.array([1.0, 2.25, np.nan, 4, 5])
    assert line(np.arange(5.0), y) == 'M0 1L1 2.2M3 4L4 5'


def test_band_goes_there_and_back():
    x = np.arange(3.0)
    assert band(x, x, x + 10) == 'M0 0L1 1L2 2L2 12L1 11L0 10Z'
    assert band(x, x * np.nan, x) == ''


def test_bars_stand_on_their_base():
    assert bars(np.array([0.0, 1]), np.array([0.0, 5]), 40, 0.8) == 'M1 40v-5h0.8v5z'
