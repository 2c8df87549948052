"""Tone curves of another camera: learned from most of the frame, not from what has changed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core._kernels.tones import add_offsets, add_tones, count_offsets
from rsmb_ros.core.photometric import LUMA_WEIGHTS, luma
from rsmb_ros.core.render import Shown
from rsmb_ros.core.tone_match import tone_match

SHAPE = (240, 320)
NOISE = 2.0  # grey levels


def contrast(value):
    """S-curve, as cameras offer it."""
    share = value / 255.0
    return 255.0 * share * share * (3.0 - 2.0 * share)


CURVES = {
    'contrast': contrast,
    'haze': lambda value: 0.65 * value + 60.0,
    'darker': lambda value: 255.0 * (value / 255.0) ** 1.4,
}


@pytest.fixture(scope='module')
def colours(texture_of):
    """Ground whose colours cover most of the range."""
    rng = np.random.default_rng(4)
    coarse = rng.uniform(20, 220, (6, 8, 3)).astype(np.float32)
    ground = cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_CUBIC)
    fine = texture_of(*SHAPE, 3).astype(np.float32) - 128.0
    return np.clip(ground + 0.3 * fine[..., None], 0, 240).astype(np.uint8)


def seen(image, curve, seed=5):
    noise = np.random.default_rng(seed).normal(0, NOISE, image.shape)
    return np.clip(np.rint(curve(image.astype(np.float64)) + noise), 0, 255).astype(np.uint8)


def shown(image):
    return Shown(luma(image), image, np.ones(SHAPE, bool))


def test_equal_tones_are_left_alone(colours, executor):
    live = seen(colours, lambda value: value)
    assert tone_match(shown(colours), live, luma(live), executor) is None


@pytest.mark.parametrize('name', CURVES)
def test_another_curve_is_found(colours, name, executor):
    live = seen(colours, CURVES[name])
    match = tone_match(shown(colours), live, luma(live), executor)
    assert match is not None
    found = match.of(shown(colours))
    expected = CURVES[name](colours.astype(np.float64))
    off = found.colours - expected
    assert np.sqrt(np.mean(off**2)) < 1.0
    assert np.sqrt(np.mean((found.grey - expected @ LUMA_WEIGHTS) ** 2)) < 1.0


def test_each_colour_has_its_own(colours, executor):
    live = seen(colours, lambda value: value * np.array([0.8, 1.0, 1.15]))
    match = tone_match(shown(colours), live, luma(live), executor)
    assert match is not None
    np.testing.assert_allclose(match.offsets[:, 128], [-25.6, 0.0, 19.2], atol=1.5)


@pytest.mark.parametrize('grey_one', ['reference', 'live', 'both'])
def test_one_of_the_images_may_be_grey(colours, grey_one, executor):
    known, live = shown(colours), seen(colours, contrast)
    if grey_one in ('reference', 'both'):
        grey = np.rint(luma(colours)).astype(np.uint8)
        known = Shown(luma(grey), grey, known.complete)
        live = seen(np.repeat(grey[..., None], 3, axis=2), contrast)
    if grey_one in ('live', 'both'):
        live = np.rint(luma(live)).astype(np.uint8)
    match = tone_match(known, live, luma(live), executor)
    assert match is not None
    assert match.of(known).colours.shape == known.colours.shape
    assert np.abs(match.of(known).grey - luma(live)).mean() < 3.0


def test_what_has_changed_does_not_bend_a_curve(colours, executor):
    """A seventh of the frame is darker by 60: most places at each intensity are not."""
    live = seen(colours, contrast)
    live[60:150, 80:200] = np.maximum(live[60:150, 80:200], 60) - 60
    match = tone_match(shown(colours), live, luma(live), executor)
    assert match is not None
    away = np.ones(SHAPE, bool)
    away[60:150, 80:200] = False
    off = match.of(shown(colours)).grey - contrast(colours.astype(np.float64)) @ LUMA_WEIGHTS
    assert np.abs(off[away]).mean() < 2.0
    assert (
        tone_match(shown(colours), np.where(away[..., None], colours, live), luma(live), executor)
        is None
    )


def test_too_little_to_tell_is_no_other_curve(colours, executor):
    live = seen(colours, contrast)
    none = shown(colours)._replace(complete=np.zeros(SHAPE, bool))
    assert tone_match(none, live, luma(live), executor) is None


def test_another_contrast_is_no_change_but_an_object_is(colours):
    live = seen(colours, contrast)
    found = Detector(colours).detect(live)
    assert found.status == 'registered'
    assert not found.changes
    off = Detector(colours, config=Config().replaced({'photometric.tones': False})).detect(live)
    assert np.abs(off.residual).mean() > 1.3 * np.abs(found.residual).mean()
    live[100:130, 140:180] = live[40:70, 250:290]
    (change,) = Detector(colours).detect(live).changes
    assert (abs(change.x - 140), abs(change.y - 100)) < (6, 6)


@pytest.mark.oracle
def test_kernels_do_what_numpy_does():
    rng = np.random.default_rng(7)
    before, after = (rng.integers(0, 256, (9, 13, 3), dtype=np.uint8) for _ in range(2))
    asked = rng.random((9, 13)) < 0.7
    sums = np.zeros((3, 3 * 4, 32, 3), np.int64)
    count_offsets(before, after, asked, 4, 250, 60, sums)
    y, x, c = np.nonzero((before < 250) & (after < 250) & asked[..., None])
    old, new = before[y, x, c].astype(int), after[y, x, c].astype(int)
    values = np.stack([np.ones_like(old), old, np.clip(new - old, -60, 60)], axis=-1)
    expected = np.zeros_like(sums)
    np.add.at(expected, (c, y // 4 * 4 + x // 4, old // 8), values)
    np.testing.assert_array_equal(sums, expected)

    places, offsets = rng.uniform(0, 4, 30), rng.normal(0, 5, 30)
    curve, normal, target = rng.normal(0, 3, 5), np.zeros((5, 5)), np.zeros(5)
    add_offsets(places, offsets, curve, 0.5, normal, target)
    hats = np.maximum(0.0, 1.0 - np.abs(places[:, None] - np.arange(5)))
    weights = 1.0 / np.maximum(np.abs(offsets - hats @ curve), 0.5)
    np.testing.assert_allclose(normal, hats.T @ (weights[:, None] * hats), atol=1e-9)
    np.testing.assert_allclose(target, hats.T @ (weights * offsets), atol=1e-9)

    lighter = rng.normal(0, 60, (3, 256)).astype(np.float32)
    grey = luma(before)
    out = np.empty_like(before)
    add_tones(out.ravel(), before.ravel(), lighter, LUMA_WEIGHTS, grey.ravel())
    moved = np.clip(before + lighter[np.arange(3), before], 0.0, 255.0)
    np.testing.assert_array_equal(out, np.floor(moved + np.float32(0.5)))
    np.testing.assert_allclose(grey, moved @ LUMA_WEIGHTS, atol=1e-3)
