"""Half-pixel reference and pyramid."""

from __future__ import annotations

import numpy as np

from rsmb_ros.core.sampling import defocused, half_pixel, pyramid


def test_half_pixel_keeps_the_image_and_interpolates_waves():
    y, x = np.mgrid[:40, :48].astype(np.float32)
    wave = lambda y, x: 100 + 50 * np.sin(0.6 * x + 0.4 * y)  # noqa: E731
    fine = half_pixel(wave(y, x))
    np.testing.assert_array_equal(fine[::2, ::2], wave(y, x))
    inner = np.s_[8:-8, 8:-8]
    # a wave of 10 px: the 8 taps are right to 1 % of its amplitude
    np.testing.assert_allclose(fine[1::2, 1::2][inner], wave(y + 0.5, x + 0.5)[inner], atol=0.5)
    np.testing.assert_allclose(fine[::2, 1::2][inner], wave(y, x + 0.5)[inner], atol=0.5)


def test_half_pixel_continues_edge_values():
    fine = half_pixel(np.full((10, 12), 37.0, np.float32))
    np.testing.assert_allclose(fine, 37.0, rtol=1e-6)


def test_pyramid_halves_by_means():
    image = np.arange(7 * 10, dtype=np.float32).reshape(7, 10)
    small = pyramid(image, 2)[1]
    assert small.shape == (3, 5)
    np.testing.assert_allclose(small[0, 0], image[:2, :2].mean())


def test_defocus_adds_what_a_small_blur_takes_away():
    image = np.random.default_rng(3).uniform(0, 255, (20, 2, 10, 3)).astype(np.float32)
    softer = np.random.default_rng(4).normal(0, 9, image.shape).astype(np.float32)
    expected = image + np.float32(0.3) * softer
    np.testing.assert_allclose(defocused(image, softer, 0.3), expected, rtol=1e-5, atol=1e-4)
    out = np.zeros_like(image)
    defocused(image[4:9], softer[4:9], 0.3, out=out[4:9])
    np.testing.assert_allclose(out[4:9], expected[4:9], rtol=1e-5, atol=1e-4)  # float32
    assert not out[:4].any()
    assert not out[9:].any()
    assert defocused(image, softer, 0.0) is image
