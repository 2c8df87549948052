"""Outlines draw what the mask holds, in few bytes."""

import re

import cv2
import numpy as np

from rsmb_ros.report.outlines import outline_path


def drawn(path, shape):
    """Fill a path, even-odd, as a browser does."""
    parts = [
        np.array([[float(v) for v in point.split()] for point in part.split('L')])
        for part in re.findall(r'M([^Z]+)Z', path)
    ]
    picture = np.zeros(shape, np.uint8)
    cv2.fillPoly(picture, [np.rint(part).astype(np.int32) for part in parts], 1)
    return picture


def blobs(rows, cols, seed):
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(size=(rows, cols)), (0, 0), 6)
    return noise > 0.5 * noise.std()


def test_path_fills_the_mask_and_leaves_its_holes():
    mask = blobs(200, 300, 20170304)
    mask[20:180, 30:120] = True
    mask[60:120, 50:100] = False
    found = drawn(outline_path(mask), mask.shape)
    wrong = np.count_nonzero(found != mask)
    assert wrong < 0.03 * mask.size  # outlines lie on pixels, and may be 0.7 px off
    assert found[90, 75] == 0


def test_small_pieces_are_left_out():
    mask = np.zeros((50, 50), np.uint8)
    mask[10:30, 10:30] = 255
    mask[40:42, 40:42] = 255
    assert outline_path(mask, least_area=12).count('M') == 1
    assert outline_path(mask).count('M') == 2


def test_path_is_bounded_for_any_mask():
    rng = np.random.default_rng(20170305)
    speckles = rng.random((480, 640)) < 0.3
    path = outline_path(speckles, most_points=500)
    assert len(re.findall('[ML]', path)) <= 500
    assert path


def test_path_is_moved():
    mask = np.zeros((20, 20), np.uint8)
    mask[5:10, 5:10] = 1
    assert '105 5' in outline_path(mask, move=lambda points: points + np.array([100, 0]))
    assert outline_path(mask, move=lambda points: points * np.nan) == ''


def test_empty_mask_has_no_path():
    assert outline_path(np.zeros((20, 20), bool)) == ''
