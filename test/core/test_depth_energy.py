"""How well a depth explains an object: the kernel against plain numpy, and against rendering."""

from __future__ import annotations

import naive
import numpy as np
import pytest

from rsmb_ros.core.depth_energy import (
    FINE_STEPS,
    MAX_Z2,
    SPACINGS,
    PathEnergy,
    RenderedEnergy,
    Sight,
)
from rsmb_ros.core.evidence import NoiseTable, Texture
from rsmb_ros.core.motion import CameraPath
from rsmb_ros.core.photometric import Light
from rsmb_ros.core.render import Shown, Window
from rsmb_ros.core.sampling import half_pixel

SHAPE = (40, 48)  # of the live frame
GAMMA = 2.2
LIGHT = Light(np.array([1.1, 0.05, -0.04, -0.1]), 1.5)


@pytest.fixture(scope='module')
def noise(texture_of):
    rng = np.random.default_rng(6)
    image = texture_of(120, 160, 7).astype(np.float32)
    residual = rng.normal(0, 1, image.shape) * (2.0 + image / 60.0)
    valid = np.ones(image.shape, bool)
    return NoiseTable.learn(Texture.of(image), residual.astype(np.float32), valid)


@pytest.fixture(scope='module')
def live(texture_of):
    return texture_of(*SHAPE, 8).astype(np.float32)


def naive_energy(path: CameraPath, fine, live, noise, window, mask, depth):
    """Mean truncated z^2 of a mask, the noise that of the live window's texture."""
    weight = 1.0 / noise.variances[Texture.of(live[window.box]).code]
    stretch = max(1.0, 1.0 / depth)
    field = LIGHT.gain_field(SHAPE)
    energies = []
    for row in np.flatnonzero(mask.any(axis=1)):
        y = window.top + row
        still = path.samples_per_row(1.0)[y]
        count = max(2, int(np.ceil((still - 1) * stretch / SPACINGS[1])) + 1)
        linear = naive.blurred_row(fine, path, y, count, depth) * field[y] + LIGHT.bias
        shown = 255.0 * (np.clip(linear, 0, 255) / 255.0) ** (1 / GAMMA)
        z2 = (live[y] - shown)[window.left : window.right] ** 2 * weight[row]
        energies.append(np.where(np.isnan(z2), MAX_Z2, np.minimum(z2, MAX_Z2))[mask[row]])
    return np.concatenate(energies).mean()


@pytest.mark.oracle
@pytest.mark.parametrize('window', [Window(14, 30, 9, 35), Window(0, 12, 0, 20)])
def test_energy_is_the_mean_truncated_misfit_of_the_rendered_object(
    bent_path, texture_of, noise, live, window
):
    fine = half_pixel(texture_of(44, 52, 3).astype(np.float32))
    mask = np.random.default_rng(9).random((window.bottom - window.top, 26)) < 0.6
    mask = mask[:, : window.right - window.left]
    mask[3] = False
    energy = PathEnergy(live, noise, Sight(fine, bent_path, LIGHT, GAMMA))
    found = energy.best(window, mask, np.array([0.8, 1.15]), reach=20.0)
    for depth, value in ((found.depth, found.energy), (1.0, found.background)):
        expected = naive_energy(bent_path, fine, live, noise, window, mask, depth)
        # a column at the reference's edge may be one pixel off; display values are interpolated
        assert abs(value - expected) < 0.01 * expected
    asked = (0.8, 1.15)
    assert min(abs(found.depth - d) for d in asked) <= sum(FINE_STEPS)


@pytest.mark.oracle
def test_what_the_reference_does_not_show_takes_the_most(bent_path, noise, live):
    far = bent_path.control.copy()
    far[:, 0] += 500.0
    path = CameraPath(bent_path.grid, far, *_timing(bent_path))
    energy = PathEnergy(live, noise, Sight(np.ones((88, 104), np.float32), path, LIGHT, GAMMA))
    mask = np.ones((10, 10), bool)
    found = energy.best(Window(5, 15, 5, 15), mask, np.array([0.9, 1.1]), reach=20.0)
    assert found.energy == found.background == MAX_Z2


@pytest.mark.oracle
def test_a_mask_that_holds_nothing_is_answered(bent_path, texture_of, noise, live):
    fine = half_pixel(texture_of(44, 52, 3).astype(np.float32))
    energy = PathEnergy(live, noise, Sight(fine, bent_path, LIGHT, GAMMA))
    nothing = np.zeros((10, 10), bool)
    found = energy.best(Window(5, 15, 5, 15), nothing, np.array([0.9]), reach=20.0)
    assert found.energy == found.background == 0.0


def test_depths_that_move_nothing_are_not_asked(bent_path, texture_of, noise, live):
    """A camera that stays in one place sees no parallax: the first depth is as good as any."""
    fine = half_pixel(texture_of(44, 52, 3).astype(np.float32))
    energy = PathEnergy(live, noise, Sight(fine, bent_path, LIGHT, GAMMA))
    mask = np.ones((10, 10), bool)
    depths = np.arange(0.6, 1.2, 0.1)
    found = energy.best(Window(5, 15, 5, 15), mask, depths, reach=1e-3)
    assert found.depth == depths[0]


def test_both_ways_of_comparing_depths_agree(texture_of, noise, live, bent_path):
    """A reference seen at a depth is found there by either."""
    image = texture_of(44, 52, 3).astype(np.float32)
    fine = half_pixel(image)
    sight = Sight(fine, bent_path, Light.same(), 1.0)
    window, true = Window(8, 34, 8, 40), 0.8
    counts = bent_path.samples_per_row(1.0, 1.0 / true)
    shown = np.stack([naive.blurred_row(fine, bent_path, y, counts[y], true) for y in range(40)])
    mask = np.isfinite(shown)[window.box]
    live = np.nan_to_num(shown).astype(np.float32)

    def render(depth, window, shift):
        rows = range(window.top, window.bottom)
        own = [naive.blurred_row(fine, bent_path, y, counts[y], depth) for y in rows]
        part = np.stack(own)[:, window.left : window.right]
        return Shown(np.nan_to_num(part), None, np.isfinite(part))

    own = PathEnergy(live, noise, sight).best(window, mask, np.array([0.7, 0.9]), 5.0)
    other = RenderedEnergy(live, noise, render).best(window, mask, np.array([0.7, 0.9]), 5.0)
    for found in (own, other):
        assert found.energy < 0.5 * found.background
    assert abs(own.depth - other.depth) < 0.05


def _timing(path):
    return path.first_time, path.knot_rows, path.exposure_rows
