"""Pictures keep to their bytes, and parts to their images."""

import base64

import cv2
import numpy as np
import pytest

from rsmb_ros.report.pictures import cut_around, encoded


def decoded(picture):
    return cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize('most_bytes', [2_000, 20_000, 100_000])
def test_noise_keeps_to_its_bytes(most_bytes):
    noise = np.random.default_rng(20170306).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    picture = encoded(noise, 900, most_bytes)
    assert len(picture.data) <= most_bytes
    assert len(picture.data) > most_bytes / 4  # and uses them
    assert decoded(picture).shape == (picture.height, picture.width, 3)
    assert picture.width / picture.height == pytest.approx(4 / 3, rel=0.03)


def test_easy_picture_keeps_its_size_and_its_looks():
    ramp = np.tile(np.arange(240, dtype=np.uint8), (100, 1))
    picture = encoded(ramp, 400, 20_000)
    assert (picture.width, picture.height) == (240, 100)
    assert np.abs(decoded(picture).astype(int) - ramp).max() <= 6  # grey levels, of the JPEG
    assert encoded(ramp, 120, 20_000).width == 120
    head, data = picture.uri.split(',')
    assert head == 'data:image/jpeg;base64'
    assert base64.b64decode(data) == picture.data


@pytest.mark.parametrize(
    ('x', 'y', 'size'),
    [(50, 40, (20, 30)), (0, 0, (40, 40)), (99, 79, (41, 33)), (50, 40, (500, 9))],
)
def test_cut_lies_inside_its_image(x, y, size):
    image = np.zeros((80, 100), np.uint8)
    cut = cut_around(x, y, size, (80, 100), 16)
    assert cut.of(image).shape == (cut.height, cut.width)
    assert cut.width == min(max(size[0], 16), 100)
    assert cut.height == min(max(size[1], 16), 80)
    assert cut.left <= x <= cut.left + cut.width
    assert cut.top <= y <= cut.top + cut.height
