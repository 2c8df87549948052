"""Half-pixel reference and pyramid."""

from __future__ import annotations

import numpy as np

from rsmb_ros.core.sampling import half_pixel, pyramid


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
