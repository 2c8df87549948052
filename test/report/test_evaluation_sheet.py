"""Found, missed and false can be told apart, on any pictures."""

import itertools

import cv2
import numpy as np
import pytest

from rsmb_ros.report.evaluation_sheet import LEGEND, MISSED, case_sheet, draw_truth

SHAPE = (100, 140)


def mask(*columns):
    drawn = np.zeros(SHAPE, bool)
    drawn[:, list(columns)] = True
    return drawn


@pytest.fixture
def live():
    return np.full(SHAPE, 128, np.uint8)


@pytest.fixture
def label():
    """Columns 0..19 changed, 20..29 rim, 130..139 outside."""
    drawn = np.zeros(SHAPE, np.uint8)
    drawn[:, :20], drawn[:, 20:30], drawn[:, 130:] = 255, 170, 85
    return drawn


def nearest(pixel):
    """Name of the colour of the legend that a tinted grey of 128 looks like."""
    tinted = {name: 0.35 * 128 + 0.65 * np.array(color) for name, color in LEGEND.items()}
    name = min(tinted, key=lambda name: np.abs(tinted[name] - pixel).max())
    return name if np.abs(tinted[name] - pixel).max() <= 1 else ''  # rounding


def test_every_pixel_is_coloured_by_what_it_is(live, label):
    change = mask(*range(10, 60), *range(125, 140))
    valid = ~mask(*range(50, 70), 0)
    row = [nearest(pixel) for pixel in draw_truth(live, change, valid, label)[50].astype(float)]
    named = [(name, len(list(group))) for name, group in itertools.groupby(row)]
    assert named == [
        ('missed', 10),
        ('found', 10),
        ('ignored', 10),
        ('false alarm', 20),
        ('not judged', 20),  # its first half was reported, but is not valid
        ('', 55),
        ('false alarm', 5),
        ('ignored', 10),
    ]


def test_live_image_is_not_drawn_into_and_loses_its_colours(live, label):
    color = cv2.merge([live, live, live + 100])
    picture = draw_truth(color, mask(), ~mask(), label)
    assert (color[..., 2] == 228).all()
    assert (np.ptp(picture[:, 60], axis=1) == 0).all()


def test_colours_differ_in_brightness_too():
    """Printed in grey, or seen with any colour vision."""
    weights = np.array([0.114, 0.587, 0.299])  # BGR
    light = {name: float(weights @ color) for name, color in LEGEND.items()}
    assert light['missed'] > light['found'] + 80
    assert light['missed'] > light['false alarm'] + 80
    assert light['not judged'] < min(light['found'], light['false alarm']) - 40


@pytest.mark.parametrize('colored', [False, True])
def test_sheet_joins_four_pictures_title_and_legend(live, label, colored):
    shown = cv2.merge([live] * 3) if colored else live
    reference = np.full((150, 210), 90, np.uint8)
    sheet = case_sheet('planar/07 rsmb', reference, shown, shown, mask(), ~mask(), label)
    assert sheet.dtype == np.uint8
    assert sheet.shape[0] > 2 * SHAPE[0]
    assert sheet.shape[1] == 2 * SHAPE[1] + 6
    assert (sheet == MISSED).all(axis=2).sum() > 100  # of the legend: tints are mixed
    assert (sheet == 90).all(axis=2).sum() > 0.9 * SHAPE[0] * SHAPE[1]


def test_registered_may_be_float_and_unknown_outside(live, label):
    registered = np.full(SHAPE, 300.4, np.float32)
    registered[:, :70] = 49.6
    registered[0, 0] = np.nan
    sheet = case_sheet('a', live, live, registered, mask(), ~mask(), label)
    assert (sheet == 50).all(axis=2).sum() >= 70 * SHAPE[0] - 1


def test_frame_that_is_not_registered_has_a_sheet(live, label):
    sheet = case_sheet('a', live, live, None, mask(), mask(), label)
    with_picture = case_sheet('a', live, live, live, mask(), mask(), label)
    assert sheet.shape == with_picture.shape
    assert (sheet != with_picture).any()  # its caption says so
