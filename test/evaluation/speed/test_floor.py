"""The floor: counted like the loops run, from the frame's own motion."""

from dataclasses import replace

import numpy as np
import pytest

from rsmb_ros.core.arrow import EXTRA
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.points import select_points
from rsmb_ros.evaluation.speed.floor import (
    POINT,
    RENDER_PIXEL,
    RENDER_SAMPLE,
    SAMPLE,
    SAMPLE_PER_DOF,
    Work,
    frame_floor,
    linearisation,
    rendering,
)
from rsmb_ros.evaluation.speed.machine import Rates

PLENTY = 1e12  # bytes


def path_of(shape=(480, 640), blur=8.0, exposure=48.0):
    """Uniform motion in x by `blur` px during an exposure."""
    path = still_path(Grid(shape, shape, 600.0), 24.0, exposure, 80.0, bottom_up=False)
    control = path.control.copy()
    control[:, 0] = np.arange(len(control)) * 24.0 * blur / exposure
    return replace(path, control=control)


def counted(points, samples, unknowns, dof):
    """Operations of one linearisation, counted loop by loop."""
    flops = 0
    for count in samples:
        for _ in range(points):
            for _ in range(count):
                flops += SAMPLE
                for _ in range(dof):
                    flops += 2 * 4 + 2  # four control points and the exposure: multiply, add
            flops += POINT
            for m in range(unknowns):
                flops += 1 + 1 + 2  # light, weight, gradient
                for _ in range(m + 1):
                    flops += 2
    return flops


@pytest.mark.parametrize('dof', [2, 6])
def test_linearisation_is_counted_like_its_loops_run(dof):
    samples = np.array([2, 5, 3])
    work = linearisation(4, samples, 11, dof, PLENTY)
    assert SAMPLE_PER_DOF == 2 * 4 + 2
    assert work.flops == counted(4, samples, 11, dof)


def test_linearisation_touches_two_lines_a_point_but_no_more_than_there_is():
    samples = np.array([2, 2])
    assert linearisation(3, samples, 8, 6, PLENTY).bytes == 2 * 3 * (2 * 64 + 16)
    assert linearisation(3, samples, 8, 6, 100.0).bytes == 100 + 2 * 3 * 16


def test_rendering_counts_every_pixel_at_every_instant():
    path = path_of((48, 64))
    samples = path.samples_per_row(1.0)
    work = rendering(path)
    assert work.flops == 64 * (samples.sum() * RENDER_SAMPLE + 48 * RENDER_PIXEL)
    assert work.bytes == 48 * 64 * (16 + 17)  # half-pixel reference, images and mask


def test_points_are_those_that_the_fit_selects():
    image = np.random.default_rng(20170301).normal(size=(480, 640)).astype(np.float32)
    levels = [image, image[::2, ::2].copy(), image[::4, ::4].copy()]
    selected = sum(select_points(level, n).columns.size for n, level in enumerate(levels))
    assert frame_floor(path_of(), 6).points == selected


def test_more_blur_costs_more_instants_and_not_more_unknowns():
    short, long = (frame_floor(path_of(blur=blur), 6) for blur in (4.0, 16.0))
    assert short.samples == pytest.approx(5, abs=1)  # one px between two instants, both ends
    assert long.samples == pytest.approx(17, abs=1)
    assert long.unknowns == short.unknowns == (48 / 24 + 4) * 6 + EXTRA
    assert 1.2 < long.fit.flops / short.fit.flops < 2  # the unknowns cost most
    assert long.render.flops / short.render.flops > 2.5


def test_four_times_the_pixels_cost_about_four_times_the_floor():
    """The coarsest level is the same at both sizes, and rendering has no other overhead."""
    small, large = (frame_floor(path_of(shape), 6) for shape in ((480, 640), (960, 1280)))
    assert 3 < large.fit.flops / small.fit.flops < 4.5
    assert large.render.flops / small.render.flops == pytest.approx(4, rel=0.01)


def test_floor_of_a_usual_frame_is_milliseconds():
    """Some 100 MFLOP for the fit and some 30 MFLOP for rendering at 640x480 and 8 px of blur."""
    floor = frame_floor(path_of(), 6)
    assert 5e7 < floor.fit.flops < 3e8
    assert 2e7 < floor.render.flops < 6e7
    assert 1e-4 < floor.seconds(Rates(1e11, 1e10)) < 1e-2


def test_time_is_that_of_the_slower_of_loading_and_calculating():
    rates = Rates(flops=100.0, bytes=10.0)
    assert Work(200.0, 1.0).seconds(rates) == 2.0
    assert Work(200.0, 50.0).seconds(rates) == 5.0


def test_work_adds_up():
    assert Work(1.0, 2.0) + Work(10.0, 20.0).times(2) == Work(21.0, 42.0)
