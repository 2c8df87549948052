"""Every kernel against the literal equations of naive.py."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import naive
import numpy as np
import pytest

from rsmb_ros.core._kernels import fit, fit_row, geometry, render, synthesis
from rsmb_ros.core._kernels.normal import assemble, assemble_gradient
from rsmb_ros.core.arrow import Arrow
from rsmb_ros.core.motion import homographies
from rsmb_ros.core.normal_equations import tone_table
from rsmb_ros.core.render import blurred, shown_at
from rsmb_ros.core.sampling import HALF_PIXELS, half_pixel, softened

pytestmark = pytest.mark.oracle
LIGHT = np.array([1.1, 0.03, -0.02, -0.08, 1.5])
GAMMA = 2.2


def test_homography_is_rotation_plus_scaled_translation():
    rng = np.random.default_rng(1)
    for depth in (1.0, 0.7, 1.4):
        q = rng.normal(0, [20, 20, 12, 6, 3, 3])
        out = np.empty(9)
        geometry.homography(q, 500.0, 320.0, 1.0 / depth, out)
        expected = naive.homography(q, 500.0, 320.0, depth)
        np.testing.assert_allclose(out.reshape(3, 3), expected, rtol=1e-9, atol=1e-12)


def test_spline_of_the_kernel_is_the_textbook_spline(bent_path):
    for time in (-7.3, 0.0, 3.99, 4.0, 21.5, 39.9, 47.0, 60.0):
        out = np.zeros(6)
        render.pose_at(time, bent_path.control, bent_path.first_time, bent_path.knot_rows, out)
        expected = naive.path_coordinates(
            bent_path.control, bent_path.first_time, bent_path.knot_rows, time
        )
        np.testing.assert_allclose(out, expected, atol=1e-5)  # ends are clamped 1e-6 apart
        np.testing.assert_allclose(bent_path.coordinates(np.array([time]))[0], out, atol=1e-9)


def test_centroids_are_means_over_each_rows_exposure(bent_path):
    path = replace(bent_path, bottom_up=True)
    spread = ((np.arange(16) + 0.5) / 16 - 0.5) * path.exposure_rows
    expected = path.coordinates(path.row_times[:, None] + spread).mean(axis=1)
    found = path.row_centroids()
    np.testing.assert_allclose(found, expected, atol=1e-9)
    found[:] = 0.0
    np.testing.assert_allclose(path.row_centroids(), expected, atol=1e-9)  # a copy was changed


@pytest.mark.parametrize('depth', [1.0, 0.8])
@pytest.mark.parametrize('bottom_up', [False, True])
def test_blurred_rows_are_the_mean_of_warped_rows(
    bent_path, texture_of, executor, depth, bottom_up
):
    fine = half_pixel(texture_of(44, 52, 3).astype(np.float32))
    path = replace(bent_path, bottom_up=bottom_up)
    image, complete = blurred(fine, path, executor, depth)
    counts = path.samples_per_row(1.0, stretch=max(1.0, 1.0 / depth))
    assert 0.5 < complete.mean() < 1.0
    steepest = max(np.abs(np.diff(fine, axis=axis)).max() for axis in (0, 1)) * 2  # per px
    for row in range(0, 40, 3):
        expected = naive.blurred_row(fine, path, row, counts[row], depth)
        known = complete[row]
        # places along a row are off by BENT px at most, in x and in y
        limit = 2 * render.BENT * steepest
        np.testing.assert_allclose(image[row][known], expected[known], atol=limit)
        assert np.all(image[row][~known] == 0)
        # what the kernel calls incomplete may only be a pixel more than what is
        assert np.count_nonzero(~np.isnan(expected)) - np.count_nonzero(known) <= 1


def test_strongest_gradients_are_found(texture_of):
    image = texture_of(30, 61, 4).astype(np.float32)
    rows = np.arange(0, 30, 4)
    columns = np.zeros((len(rows), 8), np.int64)
    values = np.zeros((len(rows), 8), np.float32)
    fit_row.strongest_gradients(image, rows, columns, values)
    expected = naive.strongest_gradients(image, rows, 8)
    np.testing.assert_array_equal(columns, expected)
    np.testing.assert_array_equal(values, image[rows[:, None], expected])


class _Points:
    """A few points of a small frame and their normal equations."""

    def __init__(self, path, texture_of, dof, depths=None):
        self.path, self.dof = path, dof
        self.fine = half_pixel(texture_of(44, 52, 5).astype(np.float32))
        self.softer = softened(self.fine, HALF_PIXELS)
        rng = np.random.default_rng(6)
        self.rows = np.array([7, 19, 20, 31])
        self.columns = np.sort(rng.integers(6, 42, (4, 5)), axis=1)
        self.values = rng.uniform(80, 170, (4, 5)).astype(np.float32)
        self.count = 5
        self.bounds = np.array([0, 1, 4])
        self.depths = np.ones((4, 5))
        self.inverse_depth = None
        if depths is not None:
            self.depths = rng.uniform(*depths, (4, 5))
            self.inverse_depth = (1 / self.depths).astype(np.float32)

    def linearise(
        self, light=LIGHT, sigma=50.0, tukey=False, misplaced=0.0, softened=0.0, lens=True
    ):
        """Normal matrix, gradient, residuals; keeps what `corrected` needs."""
        room = len(self.path.control) * self.dof + fit_row.AHEAD + fit_row.SPARE
        self.begins = np.zeros(2, np.int64)
        self.chunks = np.zeros((2, room, room)), np.zeros((2, room))
        rows, points = self.values.shape
        self.kept = (
            np.zeros((rows, room, points), np.float32),
            np.zeros((rows, 2), np.int64),
            np.zeros((rows, points), np.float32),
            np.zeros((rows, points), np.float32),
        )
        residuals = np.zeros(self.values.shape, np.float32)
        data = *self.data(light, sigma, misplaced, tukey, softened), lens
        fit.linearise(0, 2, *data, self.begins, *self.chunks, residuals, *self.kept)
        arrow = Arrow.empty(len(self.path.control) * self.dof, room)
        assemble(self.begins, self.dof, self.chunks[0], *arrow.parts)
        return arrow.dense(), self.gradient(), residuals

    def corrected(self, light=LIGHT, sigma=50.0, tukey=False, misplaced=0.0, softened=0.0):
        """Gradient and residuals on the Jacobians of the last `linearise`."""
        residuals = np.zeros(self.values.shape, np.float32)
        data = *self.data(light, sigma, misplaced, tukey, softened), False
        fit.correct(0, 2, *data, self.begins, *self.chunks, residuals, *self.kept)
        return self.gradient(), residuals

    def gradient(self):
        """Sum of the chunks', path first."""
        total = np.zeros(len(self.path.control) * self.dof + fit_row.AHEAD)
        assemble_gradient(self.begins, self.dof, self.chunks[1], total)
        return total[: total.size - fit_row.AHEAD + fit_row.EXTRA]

    def data(self, light, sigma, misplaced, tukey, softened):
        places = (self.columns - self.path.grid.center[0]).astype(np.float32)
        return (
            self.bounds, self.fine.ravel(), self.softer.ravel(), *self.fine.shape,
            self.rows, self.path.row_times[self.rows], np.full(4, self.count), places,
            self.values, self.inverse_depth, self.path.control, self.path.first_time,
            self.path.knot_rows, self.path.exposure_rows, softened, self.path.grid.focal_px,
            self.path.grid.center, 1.0, self.dof, light, tone_table(GAMMA), GAMMA, sigma,
            misplaced, tukey,
        )  # fmt: skip

    def literal_residuals(self, light=LIGHT, softened=0.0):
        fine = self.fine + softened * self.softer
        found = [
            naive.point_residual(
                fine, self.path, row, column, value, self.count, light, GAMMA, depth
            )
            for row, columns, values, depths in zip(
                self.rows, self.columns, self.values, self.depths, strict=True
            )
            for column, value, depth in zip(columns, values, depths, strict=True)
        ]
        return np.array([1e9 if r is None else r for r in found]).reshape(self.values.shape)


def _single(points, r):
    """Return the points of one row, linearised."""
    single = copy(points)
    single.bounds = np.array([r, r + 1, r + 1])
    single.linearise()
    return single


@pytest.mark.parametrize('depths', [None, (0.5, 0.8)])
def test_residuals_of_the_fit_are_those_of_the_image_model(bent_path, texture_of, depths):
    points = _Points(bent_path, texture_of, 6, depths)
    _, _, residuals = points.linearise()
    np.testing.assert_allclose(residuals, points.literal_residuals(), rtol=1e-4, atol=5e-3)


@pytest.mark.parametrize('depths', [None, (0.5, 0.8)])
@pytest.mark.parametrize('dof', [2, 4, 6])
def test_gradient_of_the_fit_is_the_slope_of_its_cost(bent_path, texture_of, dof, depths):
    """With equal weights J^T r is minus half the slope of sum r^2, unknown by unknown."""
    points = _Points(bent_path, texture_of, dof, depths)
    # a smooth reference and a huge sigma: every weight is 1, every slope well defined
    _, gradient, residuals = points.linearise(sigma=1e6)
    assert np.all(residuals < 1e8)
    step = 1e-3

    def cost(change_control=None, light=LIGHT, exposure=0.0, defocus=0.0):
        moved = bent_path.control.copy()
        if change_control is not None:
            moved[change_control] += step
        points.path = replace(
            bent_path, control=moved, exposure_rows=bent_path.exposure_rows + exposure
        )
        return (points.literal_residuals(light, defocus) ** 2).sum()

    base = cost()
    extra = len(bent_path.control) * dof
    checks = [(k * dof + e, cost((k, e))) for k in (3, 4, 5) for e in range(dof)]
    for n in range(5):
        light = LIGHT.copy()
        light[n] += step * (10.0 if n == 4 else 1.0)
        checks.append((extra + n, cost(light=light)))
    checks.append((extra + 5, cost(exposure=step)))
    checks.append((extra + 6, cost(defocus=step)))
    slopes = np.array([-(moved - base) / (2 * step) for _, moved in checks])
    found = gradient[[index for index, _ in checks]]
    # tilts and turns use the derivative at a small angle: a few per cent of the largest slope,
    # of unknowns of one kind: those of the light are a hundred times the others
    path, light, blur = slice(0, 3 * dof), slice(3 * dof, 3 * dof + 5), slice(3 * dof + 5, None)
    for kind in (path, light, blur) if dof == 6 else (path, light):  # all of the speed blurs
        limit = 0.04 * np.abs(slopes[kind]).max()
        np.testing.assert_allclose(found[kind], slopes[kind], atol=limit, rtol=0.04)


def test_layers_turn_around_where_their_own_centre_went(bent_path, texture_of):
    path = replace(bent_path, control=bent_path.control + np.array([10.0, 8.0, 0, 0, 0, 0]))
    points = _Points(path, texture_of, 3, (0.5, 0.6))
    points.columns = np.sort(np.random.default_rng(7).integers(2, 14, (4, 5)), axis=1)
    points.rows = np.array([4, 6, 9, 11])
    _, gradient, residuals = points.linearise(sigma=1e6)
    assert np.all(residuals < 1e8)
    base = (points.literal_residuals() ** 2).sum()
    slopes = []
    for knot in (1, 2, 3):
        points.path = replace(path, control=path.control.copy())
        points.path.control[knot, 2] += 1e-3
        slopes.append(-((points.literal_residuals() ** 2).sum() - base) / 2e-3)
    found = gradient[[3 * knot + 2 for knot in (1, 2, 3)]]
    np.testing.assert_allclose(found, slopes, atol=0.05 * np.abs(slopes).max())


@pytest.mark.parametrize('depths', [None, (0.5, 0.8)])
def test_correction_is_what_linearising_again_would_say(bent_path, texture_of, depths):
    """Same place, same residuals and gradient; elsewhere new residuals on the old Jacobians."""
    points = _Points(bent_path, texture_of, 4, depths)
    points.values[0, 2] = -1.0  # switched off
    options = {'sigma': 5.0, 'misplaced': 0.3, 'softened': 0.4}
    _, gradient, residuals = points.linearise(**options)
    again, same = points.corrected(**options)
    np.testing.assert_allclose(same, residuals, rtol=1e-5, atol=2e-3)
    np.testing.assert_allclose(again, gradient, rtol=1e-3, atol=1e-3 * np.abs(gradient).max())
    points.path = replace(bent_path, control=bent_path.control + 0.2)
    _, moved = points.corrected(**options)
    expected = points.literal_residuals(softened=0.4)
    expected[0, 2] = 1e9
    np.testing.assert_allclose(moved, expected, rtol=1e-4, atol=5e-3)


def test_defocus_is_part_of_the_residuals(bent_path, texture_of):
    points = _Points(bent_path, texture_of, 6)
    _, _, residuals = points.linearise(softened=0.7)
    expected = points.literal_residuals(softened=0.7)
    np.testing.assert_allclose(residuals, expected, rtol=1e-4, atol=5e-3)
    assert np.abs(expected - points.literal_residuals()).max() > 0.1


@pytest.mark.parametrize('count', [3, 4, 5, 7, 8])
def test_defocus_is_looked_up_at_every_other_instant_of_many(bent_path, texture_of, count):
    """The mean of those, of a row the first ones, of the next the second ones."""
    points = _Points(bent_path, texture_of, 6)
    points.count = count
    points.linearise()
    found = points.kept[3]
    for r, row in enumerate(points.rows):
        chosen = [k for k in range(count) if min(k, count - 1 - k) % 2 == r % 2 or count == 3]
        times = bent_path.row_times[row] + naive.instants(count) * bent_path.exposure_rows
        expected = [
            np.mean([_value(points.softer, bent_path, row, x, times[k]) for k in chosen])
            for x in points.columns[r]
        ]
        np.testing.assert_allclose(found[r], expected, rtol=1e-3, atol=5e-3)
    points.linearise(lens=False)
    assert not points.kept[3].any()


def _value(fine, path, row, column, time):
    """Value of a half-pixel image where a live pixel sees it at a time."""
    q = naive.path_coordinates(path.control, path.first_time, path.knot_rows, time)
    h = naive.homography(q, path.grid.focal_px, path.grid.half_width, 1.0)
    u, v = naive.warped_place(h, column, row, path.grid.center)
    return naive.bilinear(fine, 2 * v, 2 * u)[0]


def test_normal_matrix_is_the_square_of_the_jacobian(bent_path, texture_of):
    """Recover J from the gradient's response to single residuals, then compare J^T J."""
    points = _Points(bent_path, texture_of, 4)
    normal, gradient, residuals = points.linearise(sigma=1e6)
    jacobian = []
    for r, p in np.ndindex(points.values.shape):
        points.values[r, p] += 1.0
        jacobian.append(points.linearise(sigma=1e6)[1] - gradient)
        points.values[r, p] -= 1.0
    jacobian = np.array(jacobian)
    expected = np.tril(jacobian.T @ jacobian)
    np.testing.assert_allclose(normal, expected, rtol=2e-2, atol=2e-3 * np.abs(expected).max())
    np.testing.assert_allclose(
        gradient, jacobian.T @ residuals.ravel(), rtol=2e-2, atol=2e-2 * np.abs(gradient).max()
    )


@pytest.mark.parametrize('dof', [2, 3, 5, 6])
def test_rows_of_one_chunk_add_up(bent_path, texture_of, dof):
    """Sums are made four unknowns at a time: those of one row must not reach into another's."""
    one, many = _Points(bent_path, texture_of, dof), _Points(bent_path, texture_of, dof)
    one.bounds, many.bounds = np.array([0, 4, 4]), np.array([0, 2, 4])
    one.rows[:] = many.rows[:] = [24, 27, 20, 8]  # exposures over 2, 3, ... knots
    touched = one.linearise()[0], many.linearise()[0]
    assert len(np.unique(one.kept[1][:, 1])) > 1
    np.testing.assert_allclose(*touched, rtol=1e-5, atol=1e-5 * np.abs(touched[0]).max())
    np.testing.assert_allclose(one.gradient(), many.gradient(), rtol=1e-4, atol=1e-2)
    normal = sum(_single(one, r).linearise()[0] for r in range(4))
    np.testing.assert_allclose(normal, touched[0], rtol=1e-5, atol=1e-5 * np.abs(normal).max())
    gradient = sum(_single(one, r).corrected()[0] for r in range(4))
    np.testing.assert_allclose(gradient, one.corrected()[0], rtol=1e-4, atol=1e-2)


def test_tukey_gives_no_weight_beyond_five_sigma(bent_path, texture_of):
    points = _Points(bent_path, texture_of, 2)
    points.values[:] = 255.0  # far from anything
    normal, gradient, _ = points.linearise(sigma=1.0, tukey=True)
    assert not normal.any()
    assert not gradient.any()


def test_live_places_invert_the_row_homographies(bent_path):
    found = homographies(bent_path.row_centroids(), bent_path.grid)
    inverses = np.linalg.inv(found).reshape(-1, 9)
    map_x, map_y = np.zeros((44, 52), np.float32), np.zeros((44, 52), np.float32)
    shifts = np.zeros((40, 3))
    render.live_places(0, 44, inverses, bent_path.grid.center, 40, None, shifts, map_x, map_y)
    for u, v in ((12, 10), (25, 22), (40, 30), (20, 35)):
        gap, x, y = naive.live_place(found, u, v, bent_path.grid.center)
        assert gap < 0.6  # the nearest whole row
        # between whole rows the camera moves on: the motion of half a row
        assert np.hypot(map_x[v, u] - x, map_y[v, u] - y) < 0.6


def test_live_places_of_layers_invert_their_own_homographies(bent_path, executor):
    depth = np.where(np.arange(52) < 26, 0.8, 1.25)
    surface = np.tile((1 / depth).astype(np.float32), (44, 1))
    # steeper in the rows than what a pixel is: the nearest whole row must be near
    path = replace(bent_path, control=bent_path.control + np.array([5.0, -4.0, 0, 0, 0, 0]))
    map_x, map_y = shown_at(path, executor, surface)
    for u, v in ((12, 10), (22, 22), (30, 30), (40, 35)):
        found = homographies(path.row_centroids(), path.grid, depth[u])
        gap, x, y = naive.live_place(found, u, v, path.grid.center)
        assert gap < 0.6  # the nearest whole row
        assert np.hypot(map_x[v, u] - x, map_y[v, u] - y) < 0.6


def test_sample_is_a_cubic_spline_with_keys_alpha(texture_of):
    image = texture_of(20, 24, 8).astype(np.float32)
    flat = np.concatenate([[7.0], np.repeat(image.ravel(), 3)]).astype(np.float32)
    out, weights = np.empty(3), np.empty((2, 2, 4))
    for u, v in ((3.2, 4.7), (0.0, 0.0), (-1.5, 3.1), (22.9, 18.4), (30.0, 19.0)):
        synthesis.sample(flat, 1, 20, 24, 3, u, v, *weights, out)
        smooth = naive.cubic(image.astype(float), v, u, naive.b_spline)
        alpha = naive.cubic(image.astype(float), v, u, naive.keys)
        np.testing.assert_allclose(out, [smooth, smooth, alpha], rtol=1e-6)


def test_strong_edges_count_no_more_than_their_place_allows(bent_path, texture_of):
    """Weight sigma^2 / (sigma^2 + (misplaced |gradient|)^2): a point says <= 1 / misplaced^2."""
    points = _Points(bent_path, texture_of, 2)
    free, _, _ = points.linearise(sigma=1.0)
    points_capped = _Points(bent_path, texture_of, 2)
    normal, _, _ = points_capped.linearise(sigma=1.0, misplaced=0.5)
    size = len(bent_path.control) * 2
    translation = np.trace(normal[:size, :size])
    assert translation < np.trace(free[:size, :size])
    # 20 points, information at most 1 / 0.5^2 each (B-spline weights sum to 1)
    assert translation <= 20 / 0.5**2
