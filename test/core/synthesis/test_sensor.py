"""Each nuisance changes the image as its parameter says, and nothing else does."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core.synthesis import Nuisances
from rsmb_ros.core.synthesis.sensor import develop

SHAPE = (96, 128)
NONE = Nuisances(gamma=1.0)


def flat(value, channels=1):
    return np.full((*SHAPE, channels), float(value))


def step():
    light = flat(60.0)
    light[:, 64:] = 180.0
    return light


def developed(light, **nuisances):
    rng = np.random.default_rng(20170301)
    return develop(light, Nuisances(**{'gamma': 1.0, **nuisances}), rng).astype(float)


def test_no_nuisance_is_the_rounded_light():
    light = np.random.default_rng(1).uniform(0, 255, (*SHAPE, 3))
    np.testing.assert_allclose(developed(light), light, atol=0.5001)  # float32


def test_gain_multiplies_and_bias_adds():
    assert (developed(flat(100), gain=1.2) == 120).all()
    assert (developed(flat(100), bias=6.0) == 106).all()


def test_vignetting_takes_its_share_in_the_corners():
    image = developed(flat(200), vignetting=0.3)
    assert abs(image[48, 64] - 200) <= 1
    assert abs(image[0, 0] / 200 - 0.7) < 0.01


def test_overexposure_saturates_what_exceeds_white():
    light = np.broadcast_to(np.linspace(0, 255, 128)[None, :, None], (*SHAPE, 1))
    image = developed(light, overexposure=1.5)
    above = light[..., 0] > 255 / 1.5
    assert (image[above] == 255).all()
    np.testing.assert_allclose(image[~above], 1.5 * light[..., 0][~above], atol=0.5)  # rounding


def test_defocus_blurs_by_its_sigma():
    rows = developed(step(), defocus_px=2.0)[48]
    edge = np.diff(rows) / 120
    x = np.arange(127) + 0.5
    spread = np.sqrt(np.sum(edge * (x - np.sum(edge * x)) ** 2))
    assert abs(spread - 2.0) < 0.1  # rounding to uint8


@pytest.mark.parametrize('value', [30.0, 120.0, 200.0])
def test_poisson_noise_grows_with_the_root_of_the_light(value):
    image = developed(flat(value), noise_electrons=2000.0)
    expected = np.sqrt(value * 255 / 2000 + 1 / 12)  # + rounding
    assert abs(image.std() / expected - 1) < 0.04  # 12 288 samples: 0.6 %, clipping of the tails
    assert abs(image.mean() - value) < 0.3


def test_read_noise_is_the_same_everywhere():
    for value in (40.0, 200.0):
        assert abs(developed(flat(value), read_noise=3.0).std() - 3.01) < 0.1


def test_mosaic_keeps_flat_colour_and_loses_fine_colour():
    light = flat(0, 3)
    light[..., 0], light[..., 1], light[..., 2] = 40, 90, 160
    np.testing.assert_allclose(developed(light, mosaic=True), light, atol=1)
    fine = flat(60, 3)
    fine[:, ::2, 2] = 180  # red stripes one pixel wide are beyond the filters
    error = np.abs(developed(fine, mosaic=True) - fine)[8:-8, 8:-8, 2]
    assert error.mean() > 20


def test_mosaic_of_a_grey_camera_is_nothing():
    np.testing.assert_array_equal(developed(step(), mosaic=True), developed(step()))


def test_gamma_is_the_tone_curve():
    image = developed(flat(64), gamma=2.2)
    assert abs(image[0, 0] - 255 * (64 / 255) ** (1 / 2.2)) <= 0.5


def test_contrast_bends_the_picture_and_keeps_its_ends():
    values = np.array([0, 40, 127.5, 220, 255])
    light = np.repeat(values[:, None, None], 64, axis=1)
    more, less = (developed(light, contrast=c)[:, 0] for c in (0.8, -0.6))
    assert more[0] == less[0] == 0
    assert more[-1] == less[-1] == 255
    assert more[1] < 40 - 10
    assert less[1] > 40 + 8
    assert more[3] > 220 + 8
    assert less[3] < 220 - 6
    assert abs(more[2] - 127.5) <= 1


def test_warmth_trades_blue_for_red():
    image = developed(np.full((*SHAPE, 3), 100.0), warmth=0.1)
    np.testing.assert_array_equal(image[0, 0], [90, 100, 110])
    np.testing.assert_array_equal(developed(flat(100), warmth=0.1), developed(flat(100)))


def test_noise_is_added_to_light_and_so_larger_in_the_dark():
    dark, bright = (developed(flat(v), gamma=2.2, read_noise=1.0).std() for v in (15, 200))
    assert dark > 2 * bright


def test_sharpening_overshoots_at_edges_only():
    image = developed(step(), sharpening=0.5)
    assert image.max() > 190
    assert image.min() < 50
    assert (image[:, :50] == 60).all()
    assert (image[:, 78:] == 180).all()


def test_jpeg_is_what_the_codec_makes():
    rng = np.random.default_rng(3)
    light = cv2.GaussianBlur(rng.uniform(0, 255, (*SHAPE, 3)), (0, 0), 1.5)
    plain = np.rint(light).astype(np.uint8)
    _, code = cv2.imencode('.jpg', plain, [cv2.IMWRITE_JPEG_QUALITY, 40])
    expected = cv2.imdecode(code, cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(developed(light, jpeg_quality=40), expected)
    worse, better = (np.std(developed(light, jpeg_quality=q) - plain) for q in (40, 95))
    assert worse > better > 0


def test_reference_has_the_camera_but_not_the_difference_of_light():
    given = Nuisances(1.2, 3.0, 0.2, 1.1, 0.5, 5000, 0.4, True, 2.0, 0.5, 0.1, 0.3, 90, 0.01)
    reference = given.of_reference
    assert (reference.gain, reference.bias, reference.vignetting, reference.defocus_px) == (
        1,
        0,
        0,
        0,
    )
    assert (reference.contrast, reference.warmth) == (0, 0)
    assert (reference.noise_electrons, reference.jpeg_quality) == (5000, 90)
    assert (reference.overexposure, reference.distortion) == (1.1, 0.01)


def test_infinitely_many_electrons_are_none_in_json():
    assert Nuisances().as_dict()['noise_electrons'] is None
    assert Nuisances(noise_electrons=10.0).as_dict()['noise_electrons'] == 10.0
