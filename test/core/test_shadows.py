"""A shadow that comes or goes is told from an object, by what shows through it."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.evidence import NoiseTable, Texture
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.segmentation import Blob
from rsmb_ros.core.shadows import shadow_like
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import GONE, NEW, Nuisances, Scene, Sheet, live_frame, reference_image
from rsmb_ros.core.synthesis.objects import any_object, appearing, cast_shadow, soft_blob
from rsmb_ros.core.synthesis.paths import Hover

SHAPE = (200, 240)
BLOB = Blob(np.ones((50, 70), bool), 80, 70)
NOISE = 1.5  # grey levels
MOST = 5.0  # sigma


@pytest.fixture(scope='module')
def ground(texture_of):
    return texture_of(*SHAPE, 5)


def finding(before, change):
    """A settled frame: `change` takes clean float display values to those of the live frame."""
    rng = np.random.default_rng(20141)
    clean = before.astype(np.float32)
    changed = clean.copy()
    changed[BLOB.box] = change(clean[BLOB.box])
    live = np.clip(np.rint(changed + rng.normal(0, NOISE, clean.shape)), 0, 255).astype(np.uint8)
    # the reference is an image, too
    shown = np.clip(np.rint(clean + rng.normal(0, NOISE / 2, clean.shape)), 0, 255)
    grey, predicted = (
        (image if image.ndim == 2 else image.mean(axis=2)).astype(np.float32)
        for image in (live, shown)
    )
    judged = np.ones(SHAPE, bool)
    noise = NoiseTable.learn(Texture.of(predicted), grey - predicted, judged)
    frame = SimpleNamespace(
        live=live,
        grey=grey,
        predicted=predicted,
        judged=judged,
        misfit=np.ones(SHAPE, np.float32),
        row_uncertainty=np.full(SHAPE[0], 0.02),
        registered=lambda: shown.astype(np.uint8),
    )
    return SimpleNamespace(frame=frame, seen=SimpleNamespace(noise=noise))


@pytest.mark.parametrize('light', [0.3, 0.5, 0.8, 1.25, 1.6])
def test_ground_in_another_light_is_a_shadow(ground, light):
    found = finding(ground, lambda part: np.minimum(part * light ** (1 / 2.2), 250))
    assert shadow_like(BLOB, found, MOST)


def test_half_shadow_at_the_outline_is_part_of_it(ground):
    cover = np.zeros(BLOB.mask.shape, np.float32)
    cover[8:-8, 8:-8] = 0.5
    light = 1.0 - cv2.GaussianBlur(cover, (0, 0), 4.0)
    assert shadow_like(BLOB, finding(ground, lambda part: part * light ** (1 / 2.2)), MOST)


def test_dark_object_on_ground_without_texture_is_none():
    """Nothing shows through it, nor would through a shadow: not known, so an object."""
    slope = np.linspace(130, 150, SHAPE[1]) + np.linspace(-8, 8, SHAPE[0])[:, None]
    assert not shadow_like(BLOB, finding(slope, lambda part: part * 0.6), MOST)
    assert not shadow_like(BLOB, finding(slope, lambda part: 0 * part + 60), MOST)


def test_objects_are_none(ground, texture_of):
    other = texture_of(*BLOB.mask.shape, 6).astype(np.float32)
    for change in (lambda part: 0 * part + 60, lambda part: 0.6 * other, lambda part: 255 - part):
        assert not shadow_like(BLOB, finding(ground, change), MOST)


def test_an_object_in_a_shadow_is_not_lost(ground):
    def change(part):
        part = part * 0.7
        part[20:32, 25:45] = 40.0
        return part

    assert not shadow_like(BLOB, finding(ground, change), MOST)


def test_misplaced_ground_is_none(ground):
    """Texture that shows through in the same light is no change of light."""
    found = finding(ground, lambda part: np.roll(part, 1, axis=1))
    assert not shadow_like(BLOB, found, MOST)


@pytest.mark.parametrize(('tint', 'shadow'), [((0.74, 0.7, 0.7), True), ((0.9, 0.7, 0.6), False)])
def test_all_colours_change_alike(ground, tint, shadow):
    colours = np.stack([ground] * 3, axis=-1)
    found = finding(colours, lambda part: part * np.array(tint, np.float32))
    assert shadow_like(BLOB, found, MOST) == shadow


def test_too_little_is_not_judged(ground):
    small = Blob(np.ones((18, 18), bool), 80, 70)
    found = finding(ground, lambda part: part * 0.7)
    assert not shadow_like(small, found, MOST)
    found.frame.judged[:, 85:] = False
    assert not shadow_like(BLOB, found, MOST)


@pytest.mark.parametrize('kind', [NEW, GONE])
def test_passing_shadow_is_reported_as_such_or_suppressed(texture_of, kind):
    scene = Scene(texture_of(480, 560, 9), margin=40)
    grid = Grid((400, 480), scene.shape, 430.0)
    hover = Hover(9.0, 5.0, 30.0, 6e-5, phase=0.7)
    rng = np.random.default_rng(8)
    cloud = Sheet(np.zeros((90, 110), np.uint8), soft_blob((90, 110), rng, 0.1), 120.0, 90.0)
    car = appearing(any_object(rng), 320.0, 260.0, 'car', kind)
    things = (appearing(cast_shadow(cloud, 0.4), 120.0, 90.0, 'shadow', kind), car)
    camera = Nuisances(gain=1.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)
    reference = reference_image(scene, camera, rng, [one for one in things if one.kind == GONE])
    live, _ = live_frame(
        scene, things, grid, lambda times: hover.poses(0.0, times), ShutterTiming(30.0), camera, rng
    )
    reported = Detector(reference, Camera(430.0)).detect(live)
    shade, thing = sorted(reported.changes, key=lambda one: one.y)
    assert (shade.shadow_like, thing.shadow_like) == (True, False)
    assert shade.score < 0.5 < thing.score
    config = Config.from_mapping({'change.shadows': 'suppress'})
    suppressed = Detector(reference, Camera(430.0), config).detect(live)
    assert suppressed.changes == (thing,)
    left = reported.change_mask.copy()
    left[shade.y : shade.y + shade.height, shade.x : shade.x + shade.width] = 0
    np.testing.assert_array_equal(suppressed.change_mask, left)
