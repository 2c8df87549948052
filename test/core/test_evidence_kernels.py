"""The kernels of noise, evidence and regions against plain numpy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core._kernels.evidence import (
    TEXTURE_STEP,
    count_codes,
    count_residuals,
    fill_variances,
    surprise_of_tint,
    surprise_rows,
)
from rsmb_ros.core._kernels.regions import grow_regions
from rsmb_ros.core.evidence import Texture, box_rms, gradient_energy

pytestmark = pytest.mark.oracle
SHAPE = (24, 31)


def box_mean(image, reach):
    """Mean over a square around each pixel; the image continues mirrored at its edges."""
    rows, cols = image.shape
    wide = np.pad(image.astype(float), reach, mode='reflect')
    size = range(2 * reach + 1)
    return np.mean([wide[i : i + rows, j : j + cols] for i in size for j in size], axis=0)


@pytest.fixture(scope='module')
def image(texture_of):
    image = texture_of(*SHAPE, 11).astype(np.float32)
    image[:, 20] += 130.0
    image[3, 4] = -7.0  # interpolation overshoots
    image[5, 6] = 270.0
    return image


def test_codes_hold_intensity_and_texture(image):
    texture = Texture.of(image)
    expected = gradient_energy(image)
    np.testing.assert_allclose(texture.energy, expected, rtol=1e-5, atol=1e-3)  # float32 sums
    steps = np.sqrt(box_mean(expected, 2)) / TEXTURE_STEP
    assert steps.max() > 255, 'the last step holds all beyond'
    off = (texture.code & 255) - np.minimum(np.floor(steps), 255)
    near = np.abs(steps - np.rint(steps)) < 1e-3  # rounding decides
    assert not off[~near].any()
    np.testing.assert_array_equal(texture.code >> 8, np.clip(image, 0, 255).astype(int))


@pytest.mark.parametrize('shape', [(1, 9), (2, 3), (3, 2), (4, 7)])
def test_tiny_images_are_described(shape):
    image = np.random.default_rng(2).uniform(0, 250, shape).astype(np.float32)
    texture = Texture.of(image)
    assert np.isfinite(texture.energy).all()
    np.testing.assert_array_equal(texture.code >> 8, image.astype(int))


def test_every_second_judged_pixel_is_counted(image):
    code = Texture.of(image).code
    rng = np.random.default_rng(3)
    valid = rng.random(SHAPE) < 0.7
    levels, steps = np.zeros((2, 256), np.int64)
    count_codes(code, valid, levels, steps)
    chosen = code[::2, ::2][valid[::2, ::2]]
    np.testing.assert_array_equal(levels, np.bincount(chosen >> 8, minlength=256))
    np.testing.assert_array_equal(steps, np.bincount(chosen & 255, minlength=256))
    residual = rng.normal(0, 40, SHAPE).astype(np.float32)
    level_bin, step_bin = np.arange(256) // 128 * 4, np.arange(256) // 64
    histogram = np.zeros((8, 256), np.int64)
    count_residuals(code, residual, valid, level_bin, step_bin, 4.0, histogram)
    bins = level_bin[chosen >> 8] + step_bin[chosen & 255]
    heights = np.minimum(np.abs(residual[::2, ::2][valid[::2, ::2]]) * 4.0, 255).astype(int)
    expected = np.zeros_like(histogram)
    np.add.at(expected, (bins, heights), 1)
    np.testing.assert_array_equal(histogram, expected)


def test_variances_are_interpolated_in_the_table():
    rng = np.random.default_rng(4)
    sigma = rng.uniform(1, 9, (3, 4)).astype(np.float32)
    levels = np.linspace(0, 2, 256).astype(np.float32)
    steps = np.linspace(0, 3, 256).astype(np.float32)
    out = np.empty(65536, np.float32)
    fill_variances(sigma, levels, steps, out)
    for level, step in ((0, 0), (255, 255), (100, 200), (200, 30)):
        along = [np.interp(steps[step], np.arange(4), line) for line in sigma]
        expected = np.interp(levels[level], np.arange(3), along) ** 2
        assert abs(out[level * 256 + step] - expected) < 1e-4 * expected


def test_surprise_is_the_truncated_square_of_residual_over_noise(image):
    rng = np.random.default_rng(5)
    texture = Texture.of(image)
    residual = rng.normal(0, 6, SHAPE).astype(np.float32)
    misfit = rng.uniform(1, 2, SHAPE).astype(np.float32)
    judged = rng.random(SHAPE) < 0.8
    variances = rng.uniform(1, 20, 65536).astype(np.float32)
    place = rng.uniform(0, 0.1, SHAPE[0]).astype(np.float32)
    out = np.empty(SHAPE, np.float32)
    surprise_rows(
        0, SHAPE[0], residual, misfit, judged, texture.code, texture.energy, variances, place,
        9.0, out,
    )  # fmt: skip
    noise = np.sqrt(variances[texture.code] + place[:, None] * texture.energy) * misfit
    z2 = np.where(judged, (residual / noise) ** 2, 0.0)
    np.testing.assert_allclose(out, np.minimum(z2, 9.0), rtol=1e-4)


def test_surprise_of_a_tint_is_less_where_rich_colours_may_be_off(image):
    rng = np.random.default_rng(6)
    texture = Texture.of(image)
    residual = rng.normal(0, 6, SHAPE).astype(np.float32)
    misfit = rng.uniform(1, 2, SHAPE).astype(np.float32)
    judged = rng.random(SHAPE) < 0.8
    colour = rng.integers(0, 128, SHAPE, dtype=np.uint8)
    variances = rng.uniform(1, 20, 65536).astype(np.float32)
    place = rng.uniform(0, 0.1, SHAPE[0]).astype(np.float32)
    out = np.empty(SHAPE, np.float32)
    balance, share = np.float32(1.5), np.float32(0.08)
    surprise_of_tint(
        residual, balance, misfit, judged, texture.code, texture.energy, variances, place, colour,
        share, 9.0, out,
    )  # fmt: skip
    variance = variances[texture.code] + place[:, None] * texture.energy + (share * colour) ** 2
    z2 = np.where(judged, (residual - balance) ** 2 / (variance * misfit**2), 0.0)
    np.testing.assert_allclose(out, np.minimum(z2, 9.0), rtol=1e-4)


@pytest.mark.parametrize('size', [3, 7])
def test_evidence_is_the_root_of_a_box_mean(image, size):
    expected = np.sqrt(box_mean(np.abs(image), size // 2))
    np.testing.assert_allclose(box_rms(np.abs(image), size), expected, rtol=1e-5)


@pytest.mark.parametrize('seed', range(4))
def test_regions_grow_from_what_is_strong_over_what_is_weak(seed):
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.normal(0, 9, (40, 52)).astype(np.float32), (0, 0), 2.0)
    low, high = np.float32(0.2), np.float32(2.0)
    weak = cv2.erode((image > low).astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    strong = set(labels[(image > high) & (weak > 0)])
    expected = np.isin(labels, list(strong))
    assert 0 < len(strong) < count - 1, 'some grow, some do not'
    out, box = np.zeros(image.shape, np.uint8), np.empty(4, np.int64)
    grow_regions(image, low, high, np.empty(image.size, np.int32), out, box)
    np.testing.assert_array_equal(out, expected)
    rows, cols = np.nonzero(expected)
    assert list(box) == [rows.min(), cols.min(), rows.max() + 1, cols.max() + 1]
    out[:] = 0
    grow_regions(image, low, np.float32(1e3), np.empty(image.size, np.int32), out, box)
    assert not out.any()
    assert not box.any()
