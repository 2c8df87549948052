"""The coarse search against OpenCV and numpy, the start path against a dense least squares."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rsmb_ros.core._kernels.match import ROOM, highest, match_bands
from rsmb_ros.core.coarse import EDGE, MIN_CONTRAST, MIN_PEAK, WOBBLE, CoarseSearch, sub_pixel_peak
from rsmb_ros.core.motion import Grid, still_path
from rsmb_ros.core.start import PRIORS, ROUNDS, SPLINE_SAMPLES, StripMatches, start_path

pytestmark = pytest.mark.oracle
REACH, WIDTH, HEIGHT = 7, 30, 9


def matched(small, reference, textured, top, x, y):
    """Pieces of a band as `match_bands` finds them."""
    found, counts = np.empty((1, small.shape[1] // WIDTH, 7)), np.empty(1, np.int64)
    flat = np.append(reference, np.zeros(ROOM, np.float32))
    match_bands(
        0, 1, small, np.array([top]), HEIGHT, x, y, flat,
        *cv2.integral2(reference, sdepth=cv2.CV_64F), textured, WIDTH, REACH, EDGE, MIN_CONTRAST,
        MIN_PEAK, found, counts,
    )  # fmt: skip
    return found[0, : counts[0]]


def expected(small, reference, textured, top, x, y):
    """Do the same by OpenCV's correlation, piece after piece."""
    rows, columns = reference.shape
    found = []
    for left in range(0, small.shape[1] - WIDTH + 1, WIDTH):
        r0, r1 = max(top, EDGE - y), min(top + HEIGHT, rows - y - EDGE)
        c0, c1 = max(left, EDGE - x), min(left + WIDTH, columns - x - EDGE)
        if r1 - r0 < 5 or c1 - c0 < 12 or small[r0:r1, c0:c1].std() < MIN_CONTRAST:
            continue
        begin_y, begin_x = max(0, r0 + y - REACH), max(0, c0 + x - REACH)
        window = reference[begin_y : r1 + y + REACH, begin_x : c1 + x + REACH]
        scores = cv2.matchTemplate(window, small[r0:r1, c0:c1], cv2.TM_CCOEFF_NORMED)
        middle = begin_y + (r1 - r0) // 2, begin_x + (c1 - c0) // 2
        known = textured[
            middle[0] : middle[0] + scores.shape[0], middle[1] : middle[1] + scores.shape[1]
        ]
        peak = sub_pixel_peak(np.clip(scores, 0, 1) * known)
        if peak is not None:
            centre = (c0 + c1 - small.shape[1]) / 2, (r0 + r1 - small.shape[0]) / 2
            found.append([*centre, begin_x + peak[0] - c0, begin_y + peak[1] - r0, *peak[2:]])
    return np.reshape(found, (-1, 7))


@pytest.mark.parametrize('place', [(0, 0), (4, -3), (-9, 6), (25, 30)])
@pytest.mark.parametrize('top', [0, 27, 51])
def test_bands_are_matched_as_by_opencv(texture_of, place, top):
    scene = texture_of(110, 150, 3).astype(np.float32)
    reference = np.ascontiguousarray(scene[20:80, 20:115])
    textured = np.ones(reference.shape, np.float32)
    textured[:, :12] = 0.0
    x, y = place
    small = scene[20 + y : 80 + y, 20 + x : 115 + x]
    small = np.ascontiguousarray(np.roll(small, (1, 2), (0, 1)))  # beside the place it is told
    small[:, 60:90] = np.float32(90.0) if top == 27 else small[:, 60:90]  # a flat piece
    found = matched(small, reference, textured, top, x, y)
    wanted = expected(small, reference, textured, top, x, y)
    assert found.shape == wanted.shape
    assert len(found) or top != 27 or y == 30, 'only what the reference ends before is unseen'
    np.testing.assert_allclose(found, wanted, atol=2e-3)  # OpenCV correlates by float32 spectra


def test_a_peak_is_found_between_pixels_but_not_at_an_edge():
    y, x = np.mgrid[0:9, 0:11]
    bump = (0.9 - 0.02 * (x - 4.3) ** 2 - 0.03 * (y - 5.2) ** 2).astype(np.float32)
    found = np.empty(5)
    assert highest(bump, MIN_PEAK, found)
    np.testing.assert_allclose(found[:2], [4.3, 5.2], atol=1e-5)  # a parabola is its own
    np.testing.assert_allclose(found[3:], [0.04, 0.06], atol=1e-5)
    np.testing.assert_allclose(sub_pixel_peak(bump), found)
    assert sub_pixel_peak(bump[:6]) is None
    assert sub_pixel_peak(bump - 0.6) is None


@pytest.mark.parametrize('exposure', [0.0, 30.0, 130.0])
@pytest.mark.parametrize('bottom_up', [False, True])
def test_a_start_path_is_the_robust_least_squares_of_its_matches(exposure, bottom_up):
    rng = np.random.default_rng(5)
    grid = Grid((240, 320), (250, 310), 300.0)
    place = np.stack([rng.uniform(-150, 150, 40), rng.uniform(-130, 130, 40)], axis=1)
    shift = np.array([8.0, -5.0]) + 0.03 * place[:, ::-1] * [-1, 1] + rng.normal(0, 0.5, (40, 2))
    shift[::9] += 30.0  # some are wrong
    weight = rng.uniform(0.1, 0.6, (40, 2))
    matches = StripMatches(place, shift, weight, np.array([8.0, -5.0]))
    longest = 1.6 * exposure + 4.0
    path = start_path(matches, grid, 24.0, exposure, longest, bottom_up)
    solution = _dense(matches, still_path(grid, 24.0, exposure, longest, bottom_up))
    np.testing.assert_allclose(path.control[:, :2].T, solution[:2], atol=1e-6)
    zoom, turn = 1.0 + path.control[:, 3] / grid.half_width, path.control[:, 2] / grid.half_width
    turned = np.stack([zoom * np.sin(turn), zoom * np.cos(turn) - 1.0]) * grid.half_width
    np.testing.assert_allclose(turned, solution[2:], atol=1e-6)


def _dense(matches, path):
    """Coordinates (4, knots) by numpy."""
    knots, grid = len(path.control), path.grid
    row = np.clip(matches.place[:, 1] + grid.center[1], 0, grid.live_shape[0] - 1)
    times = np.interp(row, np.arange(grid.live_shape[0]), path.row_times)
    shares = (np.arange(SPLINE_SAMPLES) + 0.5) / SPLINE_SAMPLES - 0.5
    spline = np.mean([path.spline_basis(times + at * path.exposure_rows) for at in shares], axis=0)
    x, y = matches.place.T[:, :, None] / grid.half_width
    none = np.zeros_like(spline)
    design = np.concatenate(
        [
            np.hstack([spline, none, -y * spline, x * spline]),
            np.hstack([none, spline, x * spline, y * spline]),
        ]
    )
    target, weight = matches.shift.T.ravel(), matches.weight.T.ravel()
    first, second = (np.diff(np.eye(knots), n, axis=0) for n in (1, 2))
    prior = np.zeros((4 * knots, 4 * knots))
    for n, (bend, slope, size) in enumerate(PRIORS):
        block = np.s_[n * knots : (n + 1) * knots]
        prior[block, block] = (
            bend * second.T @ second + slope * first.T @ first + size * np.eye(knots)
        )
    trust = weight
    for _ in range(ROUNDS):
        normal = design.T @ (trust[:, None] * design) + prior
        solution = np.linalg.solve(normal, design.T @ (trust * target))
        misfit = np.hypot(*(target - design @ solution).reshape(2, -1))
        sigma = max(1.0, 1.4826 * float(np.median(misfit)))
        trust = weight * np.tile(1.0 / (1.0 + (misfit / (2 * sigma)) ** 2) ** 2, 2)
    return solution.reshape(4, knots)


def test_few_matches_give_the_offset_alone():
    none = np.zeros((0, 2))
    path = start_path(
        StripMatches(none, none, none, np.array([3.0, -2.0])),
        Grid((48, 64), (48, 64), 60.0), 24.0, 5.0, 12.0, bottom_up=False,
    )  # fmt: skip
    np.testing.assert_array_equal(
        path.control, np.tile([3.0, -2.0, 0, 0, 0, 0], (len(path.control), 1))
    )


@pytest.mark.parametrize('offset', [(12, -8), (-30, 21)])
def test_a_shifted_frame_is_found(texture_of, executor, offset):
    scene = texture_of(300, 400, 9).astype(np.float32)
    reference, (x, y) = scene[30:270, 40:360], offset
    live = scene[30 + y : 270 + y, 40 + x : 360 + x]
    matches = CoarseSearch(reference, Grid((240, 320), (240, 320), 300.0), 0.3, executor).match(
        live
    )
    assert len(matches.place) > 20
    assert np.abs(np.median(matches.shift, axis=0) - offset).max() < 0.2  # px
    assert np.abs(matches.offset - offset).max() <= 2 * WOBBLE  # of two pixels each
