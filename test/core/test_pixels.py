"""What is worked out pixel by pixel, against numpy; the lens that frames are seen through."""

from __future__ import annotations

import gc

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Detector
from rsmb_ros.core._kernels.pixels import (
    block_moments,
    mark_bright,
    row_misfits,
    some_gradients,
)
from rsmb_ros.core.buffers import Buffers
from rsmb_ros.core.lens import LENS_STEP, Lens
from rsmb_ros.core.photometric import LUMA_WEIGHTS, luma
from rsmb_ros.core.sampling import HALF_PIXELS, softened

SHAPE = (37, 53)


@pytest.fixture
def rng():
    return np.random.default_rng(20170301)


@pytest.mark.oracle
def test_grey_levels_are_the_weighted_colours(rng):
    image = rng.integers(0, 256, (*SHAPE, 3), dtype=np.uint8)
    np.testing.assert_allclose(luma(image), image @ LUMA_WEIGHTS.astype(float), atol=1e-4)
    np.testing.assert_array_equal(luma(image[:, ::-1]), luma(image)[:, ::-1])  # not contiguous
    np.testing.assert_array_equal(luma(image[..., 0]), image[..., 0])


@pytest.mark.oracle
@pytest.mark.parametrize('channels', [1, 3])
def test_what_is_bright_and_too_dark_is_marked(rng, channels):
    image = rng.integers(240, 256, (*SHAPE, channels), dtype=np.uint8)
    residual = rng.normal(size=SHAPE).astype(np.float32)
    found = np.empty(SHAPE, bool)
    mark_bright(image.ravel(), channels, 250, residual.ravel(), found.ravel())
    np.testing.assert_array_equal(found, (image >= 250).any(axis=2) & (residual < 0))


@pytest.mark.oracle
def test_misfits_of_rows_count_what_is_judged(rng):
    residual = rng.normal(0, 5, SHAPE).astype(np.float32)
    judged = rng.random(SHAPE) < 0.7
    judged[4] = False
    known, total = np.empty(SHAPE[0], np.int64), np.empty(SHAPE[0])
    row_misfits(residual, judged, known, total)
    np.testing.assert_array_equal(known, judged.sum(axis=1))
    np.testing.assert_allclose(total, (np.abs(residual) * judged).sum(axis=1), rtol=1e-5)


@pytest.mark.oracle
def test_moments_of_blocks_are_means(rng):
    one, other = rng.uniform(0, 255, (2, *SHAPE)).astype(np.float32)
    known = rng.random(SHAPE) < 0.9
    means = np.empty((4, 5, 6))
    block_moments(one, other, known, 9, means)
    for n, image in enumerate((one, other, one**2, other**2, one * other, known)):
        blocks = image[:36, :45].astype(float).reshape(4, 9, 5, 9).mean(axis=(1, 3))
        np.testing.assert_allclose(means[..., n], blocks, rtol=1e-5)


@pytest.fixture
def lens(rng):
    fine = rng.uniform(0, 255, SHAPE).astype(np.float32)
    return Lens(fine, softened(fine, HALF_PIXELS), Buffers())


def test_a_lens_adds_defocus_in_small_steps(lens, executor):
    for variance in (0.314, -0.127):
        seen = lens.seen(variance, executor)
        assert abs(seen.variance - variance) <= 0.5 * LENS_STEP
        expected = lens._sharp.fine + np.float32(seen.variance) * lens._softer
        np.testing.assert_allclose(seen.fine, expected, rtol=1e-6, atol=1e-4)
    assert lens.seen(0.3 * LENS_STEP, executor).fine is lens._sharp.fine


def test_a_lens_shows_the_same_whatever_was_seen_before(lens, executor):
    first = lens.seen(0.2, executor).fine.copy()
    lens.seen(-0.1, executor)
    np.testing.assert_array_equal(lens.seen(0.2, executor).fine, first)


def test_what_is_kept_is_not_written_over(lens, executor):
    kept = lens.seen(0.2, executor)
    before = kept.fine.copy()
    other = lens.seen(0.4, executor)
    assert lens.seen(0.4, executor) is other, 'it was worked out'
    np.testing.assert_array_equal(kept.fine, before)
    room = kept.fine
    del kept
    gc.collect()
    assert lens.seen(0.6, executor).fine is room, 'and used again when nobody keeps it'


def test_an_image_that_may_not_be_written_to_is_taken(texture_of):
    image = texture_of(96, 128, 3)
    image.flags.writeable = False
    live = np.roll(image, 2, axis=1)[:, ::-1][:, ::-1]  # rows that run backwards twice
    live.flags.writeable = False
    result = Detector(image).detect(live)
    assert result.status == 'registered'


@pytest.mark.oracle
@pytest.mark.parametrize('shape', [SHAPE, (38, 54), (2, 2), (1, 9)])
def test_gradients_of_some_pixels_are_those_of_opencv(rng, shape):
    image = rng.uniform(0, 255, shape).astype(np.float32)
    asked = rng.random(shape) < 0.7
    energies = np.full(asked.size, -1.0, np.float32)
    count = some_gradients(image, asked, energies)
    g_x, g_y = (
        cv2.Sobel(image.astype(np.float64), cv2.CV_64F, *order, scale=1 / 8)
        for order in ((1, 0), (0, 1))
    )
    some = np.s_[::2, ::2]
    expected = (g_x**2 + g_y**2)[some][asked[some]] if min(shape) > 1 else np.zeros(0)
    np.testing.assert_allclose(energies[:count], expected, rtol=1e-4, atol=1e-3)
    assert np.all(energies[count:] == -1.0)
