"""A depth map of the reference: its layers, what they show together, and what it is good for."""

from __future__ import annotations

from dataclasses import replace

import cv2
import naive
import numpy as np
import pytest

from rsmb_ros.core import Camera, Config, ConfigError, Detector, FrameError
from rsmb_ros.core._kernels import depth as kernels
from rsmb_ros.core.composite import Composition
from rsmb_ros.core.depth_map import EDGE_STEP, MOST_LAYERS, DepthMap, checked_depth
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies, still_path
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.points import select_points
from rsmb_ros.core.render import blurred
from rsmb_ros.core.sampling import half_pixel
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    CHANGED,
    Nuisances,
    Style,
    aerial_scene,
    live_frame,
    placed_objects,
    reference_depth,
    reference_image,
)
from rsmb_ros.core.synthesis.paths import Hover

SHAPE = (480, 640)
CAMERA = Camera(576.0)
REAL = Nuisances(gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)
GRID = Grid(SHAPE, SHAPE, CAMERA.focal_px)


# -- the map ---------------------------------------------------------------------------------


def test_few_depths_are_layers_as_they_are_nearest_first():
    depth = np.ones((40, 50), np.float32)
    depth[5:15, 10:20], depth[20:30, 5:40] = 0.8, 1.25
    layers = DepthMap(depth)
    assert layers.relative_depths == pytest.approx((0.8, 1.0, 1.25))
    for n, expected in enumerate((0.8, 1.0, 1.25)):
        np.testing.assert_array_equal((layers.members >> n) & 1, np.isclose(depth, expected))


def test_many_depths_are_cut_where_it_matters():
    slope = np.tile(np.linspace(0.9, 1.1, 300, dtype=np.float32), (100, 1))
    slope[0, 0], slope[0, 1] = 20.0, 0.05  # wrong pixels must not take the others' precision
    layers = DepthMap(slope)
    assert len(layers.relative_depths) <= MOST_LAYERS
    assert np.all(np.diff(layers.relative_depths) > 0)
    assert layers.relative_depths[0] == pytest.approx(0.05)
    own = np.array([[bin(bits & -bits).count('0') - 1 for bits in map(int, layers.members[50])]])
    error = 1 / slope[50] - layers.inverse_depths[own[0]]
    # 30 layers over 1/1.1 .. 1/0.9, cut in halves: no layer more than twice the mean one
    assert np.abs(error).max() < (1 / 0.9 - 1 / 1.1) / 30


def test_layers_of_a_slope_go_on_beneath_their_neighbours_and_not_beneath_an_edge():
    depth = np.tile(np.linspace(0.95, 1.05, 200, dtype=np.float32), (60, 1))
    depth[20:40, 90:110] = 0.7
    layers = DepthMap(depth)
    bits = np.array([[bin(int(bits)).count('1') for bits in row] for row in layers.members])
    assert (bits[5] == 2).mean() > 0.2  # seams
    assert np.all(bits[22:38, 92:108] == 1)
    house = 1 << layers.relative_depths.index(pytest.approx(0.7))
    assert np.all((layers.members & house > 0) == (depth < 0.8))


def test_unknown_pixels_take_the_depth_of_the_nearest_known_one():
    depth = np.ones((30, 40), np.float32)
    depth[:, 20:] = 0.5
    depth[10:20, 15:24] = np.nan
    layers = DepthMap(depth)
    np.testing.assert_array_equal(layers.unknown, np.isnan(depth))
    # the border between the two goes on through the hole, half a hole's width from either side
    assert layers.surface[15, 15] == 1.0
    assert layers.surface[15, 23] == 2.0


@pytest.mark.parametrize(
    ('depth', 'reason'),
    [
        ([[1.0]], 'depth is list'),
        (np.ones((64, 80), np.uint8), 'depth is uint8'),
        (np.ones((64, 80, 1), np.float32), r'depth is float32 \(64, 80, 1\)'),
        (np.ones((63, 80), np.float32), 'depth is 63x80 px but the reference is 64x80'),
        (np.full((64, 80), 35.0, np.float32), r'row 0, column 0 is 35 \(5120 such.*0.05 to 20'),
        (np.full((64, 80), np.inf, np.float32), 'is inf'),
        (np.full((64, 80), np.nan, np.float32), 'NaN everywhere'),
    ],
)
def test_what_is_no_depth_is_refused_with_its_value(texture_of, depth, reason):
    with pytest.raises(FrameError, match=reason):
        Detector(texture_of(64, 80, 1), depth=depth)


def test_rows_alone_take_no_depth(texture_of):
    config = Config.from_mapping(
        {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 3}
    )
    with pytest.raises(ConfigError, match='estimator = rows takes no depth map'):
        Detector(texture_of(64, 80, 1), config=config, depth=np.ones((64, 80), np.float32))


# -- the kernels -----------------------------------------------------------------------------


class _House:
    """Two nearer squares over a ground of 44 x 52 px, seen by a small bent frame."""

    def __init__(self, path, texture_of):
        self.path = path
        self.fine = half_pixel(texture_of(44, 52, 5).astype(np.float32))
        self.depth = np.ones((44, 52), np.float32)
        self.depth[12:28, 14:34] = 0.6
        self.depth[18:32, 26:40] = 0.45
        self.layers = DepthMap(self.depth)
        self.masks = [np.isclose(self.depth, d) * 1.0 for d in self.layers.relative_depths]


def _every_pixel(path, fine, layers, sole, count=7):
    """Image, known and sure of all pixels by `composite_rows`, all tiles of one kind."""
    rows, cols = path.grid.live_shape
    tiles = -(-rows // kernels.TILE), -(-cols // kernels.TILE)
    out = np.zeros((3, rows, cols), np.float32)
    kernels.composite_rows(
        0, rows, np.full(tiles, (1 << len(layers.inverse_depths)) - 1, np.uint32),
        np.full(tiles, sole), fine.ravel(), fine.shape[1], layers.members,
        layers.possible(2), 2, layers.surface, layers.uneven(2), layers.inverse_depths, 0.5,
        path.row_times, np.broadcast_to(count, rows).copy(), path.control, path.first_time,
        path.knot_rows, path.exposure_rows, path.grid.focal_px, path.grid.center, *out,
    )  # fmt: skip
    return out


@pytest.mark.oracle
def test_layers_are_composited_at_each_instant(bent_path, texture_of):
    path = replace(bent_path, control=bent_path.control + np.array([4.0, -3.0, 0, 0, 0, 0]))
    house = _House(path, texture_of)
    image, known, _ = _every_pixel(path, house.fine, house.layers, kernels.MIXED)
    checked = []
    for row in range(0, 40, 4):
        for column in range(0, 48, 3):
            light, share = naive.composited(
                house.fine, house.masks, house.layers.relative_depths, path, row, column, 7
            )
            np.testing.assert_allclose(known[row, column], share, atol=1e-3)
            if share > 0.05:
                np.testing.assert_allclose(image[row, column], light, atol=0.05)  # float32
            checked.append(share)
    # the frame shows what is known, what is hidden in the reference, and rims between
    checked = np.array(checked)
    assert (checked > 0.999).mean() > 0.5
    assert (checked < 0.2).sum() > 3
    assert ((checked > 0.2) & (checked < 0.99)).sum() > 5


@pytest.mark.oracle
def test_smooth_surfaces_are_seen_at_their_own_depth(bent_path, texture_of):
    house = _House(bent_path, texture_of)
    y, x = np.mgrid[:44, :52].astype(np.float32)
    house.layers = DepthMap((1.0 / (1.0 + 0.006 * (x - 26) - 0.004 * (y - 22))).astype(np.float32))
    image, known, _ = _every_pixel(bent_path, house.fine, house.layers, kernels.SMOOTH)
    assert (known > 0.999).mean() > 0.7
    for row, column in [(8, 10), (12, 40), (20, 24), (30, 16), (33, 35)]:
        assert known[row, column] == 1.0
        light = naive.surface_light(house.fine, house.layers.surface, bent_path, row, column, 7)
        # one step of the surface between neighbouring pixels moves by less than 0.1 px
        steepest = np.abs(np.diff(house.fine, axis=1)).max() * 2
        np.testing.assert_allclose(image[row, column], light, atol=0.1 * steepest)


@pytest.mark.oracle
@pytest.mark.parametrize('level', [0, 1])
def test_points_take_the_depth_they_see(bent_path, texture_of, level):
    path = replace(bent_path, control=bent_path.control + np.array([4.0, -3.0, 0, 0, 0, 0]))
    house = _House(path, texture_of)
    points = select_points(
        cv2.resize(texture_of(40, 48, 5), (48 >> level, 40 >> level)).astype(np.float32), level
    )
    found = points.on(house.layers, path, level)
    radius = 3 + 2 * level
    square = np.ones((2 * radius + 1,) * 2)
    spread = [cv2.dilate(mask, square) > 0 for mask in house.masks]
    even = cv2.dilate(house.depth, square) - cv2.erode(house.depth, square) == 0
    counts = path.samples_per_row(2.0 * 2**level)
    expected = np.zeros(points.columns.shape)
    for r, row in enumerate((points.rows + 0.5) * 2**level - 0.5):
        at = replace(path)
        for p, column in enumerate((points.columns[r] + 0.5) * 2**level - 0.5):
            expected[r, p] = naive.seen_depth(
                house.layers.surface, even, spread, house.layers.relative_depths,
                _between_rows(at, row), row, column, counts[int(row)], EDGE_STEP,
            )  # fmt: skip
    off = found.values < 0
    np.testing.assert_array_equal(off, expected == 0)
    np.testing.assert_allclose(found.inverse_depth[~off], expected[~off], rtol=1e-5)
    assert off.any()
    assert not off.all()
    if level == 0:
        assert len(np.unique(np.round(expected, 3))) == 4, 'edges, ground and both houses'
    assert np.all(found.inverse_depth[off] == 1.0)


class _BetweenRows:
    """A path whose rows may be asked at half of one, as those of a smaller image are."""

    def __init__(self, path):
        self._path = path

    def __getattr__(self, name):
        return getattr(self._path, name)

    @property
    def row_times(self):
        path = self._path

        class Times:
            def __getitem__(self, row):
                return np.interp(row, np.arange(len(path.row_times)), path.row_times)

        return Times()


def _between_rows(path, row):
    return _BetweenRows(path)


# -- the composition -------------------------------------------------------------------------


def _moved_path(shift, exposure=12.0):
    """A path of 120 x 160 px that bends and blurs around a shift of x, y px."""
    grid = Grid((120, 160), (120, 160), 150.0)
    path = still_path(grid, 16.0, exposure, 24.0, bottom_up=False)
    bend = np.random.default_rng(5).normal(0, [1.5, 1.5, 0.5, 0.3, 0.2, 0.2], path.control.shape)
    return replace(path, control=bend + np.array([*shift, 0, 0, 0, 0]))


@pytest.fixture(scope='module')
def town(texture_of):
    depth = np.ones((120, 160), np.float32)
    depth[30:70, 40:90], depth[60:100, 80:130], depth[10:14, 100:150] = 0.8, 0.7, 0.9
    return half_pixel(texture_of(120, 160, 8).astype(np.float32)), depth


@pytest.mark.parametrize('shift', [(0.0, 0.0), (9.0, -6.0), (-30.0, 20.0)])
def test_tiles_only_save_time(town, executor, shift):
    """What single layers show by runs of cells is what all pixels would show one by one."""
    fine, depth = town
    layers, path = DepthMap(depth), _moved_path(shift)
    seen = Composition(layers, path, executor).render(fine)
    count = path.samples_per_row(1.0, 1 / 0.7)
    image, known, sure = _every_pixel(path, fine, layers, kernels.MIXED, count)
    np.testing.assert_allclose(seen.known, known, atol=1e-3)
    np.testing.assert_allclose(seen.sure, sure, atol=1e-3)
    assert (known > 0.999).mean() > 0.4
    # a layer alone has its own number of instants; places along a row are off by 0.003 px
    np.testing.assert_allclose(seen.image, image, atol=1.0)  # grey levels


def test_without_parallax_layers_leave_no_seam(town, executor):
    fine, depth = town
    path = _moved_path((0.0, 0.0))
    path = replace(path, control=path.control * 0.0)
    seen = Composition(DepthMap(depth), path, executor).render(fine)
    plain, complete = blurred(fine, path, executor)
    np.testing.assert_allclose(seen.known[complete], 1.0, atol=1e-3)
    np.testing.assert_allclose(seen.image[complete], plain[complete], atol=0.1)
    assert np.all(seen.sure[complete] > 0.999), 'nothing moves against anything: nothing to doubt'


def test_what_a_nearer_layer_uncovers_is_unknown(texture_of, executor):
    """A camera 10 px to the right sees a house at d = 0.5 where it was 20 px further left."""
    depth = np.ones((120, 160), np.float32)
    depth[40:80, 70:110] = 0.5
    grid = Grid((120, 160), (120, 160), 150.0)
    path = still_path(grid, 16.0, 2.0, 4.0, bottom_up=False)
    path = replace(path, control=path.control + np.array([10.0, 0, 0, 0, 0, 0]))
    fine = half_pixel(texture_of(120, 160, 8).astype(np.float32))
    seen = Composition(DepthMap(depth), path, executor).render(fine)
    # the ground at x shows reference x + 10, the house reference x + 20
    house, hidden = np.s_[42:78, 52:88], np.s_[42:78, 92:98]
    assert np.all(seen.known[house] > 0.999)
    np.testing.assert_allclose(seen.image[house], fine[84:156:2, 144:216:2], atol=0.1)
    assert np.all(seen.known[hidden] < 0.001)
    ground = np.s_[42:78, 5:45]
    np.testing.assert_allclose(seen.image[ground], fine[84:156:2, 30:110:2], atol=0.1)
    assert np.all(seen.known[ground] > 0.999)
    # beside the house's edges the map may be two pixels off, on either side
    assert np.all(seen.sure[42:78, 48:52] < 0.5)
    assert np.all(seen.sure[42:78, 40:46] > 0.999)


def test_slopes_have_no_gaps_between_their_layers(texture_of, executor):
    y, x = np.mgrid[:120, :160].astype(np.float32)
    slope = 1.0 / (1.0 + 0.002 * (x - 80) + 0.001 * (y - 60))
    rng = np.random.default_rng(3)
    rough = slope * (1.0 + cv2.GaussianBlur(rng.normal(0, 0.01, slope.shape), (0, 0), 1.0))
    path = _moved_path((12.0, 8.0))
    fine = half_pixel(texture_of(120, 160, 8).astype(np.float32))
    smooth = Composition(DepthMap(slope.astype(np.float32)), path, executor).render(fine)
    noisy = Composition(DepthMap(rough.astype(np.float32)), path, executor).render(fine)
    inside = np.s_[15:95, 15:130]
    assert np.all(smooth.known[inside] > 0.99)
    assert (noisy.known[inside] > 0.98).mean() > 0.98


# -- the detector ----------------------------------------------------------------------------


def _row_errors(result, truth) -> np.ndarray:
    """Distance between found and true ground places of each row, where they are seen [px]."""
    y = np.arange(SHAPE[0]) - (SHAPE[0] - 1) / 2
    errors = []
    for x in (-240.0, 0.0, 240.0):
        points = np.stack([np.full_like(y, x), y, np.ones_like(y)], axis=1)
        found, true = (
            np.einsum('nij,nj->ni', homographies(coordinates_from_poses(poses, GRID), GRID), points)
            for poses in (result.row_motion, truth.centroids)
        )
        true = true[:, :2] / true[:, 2:]
        seen = (np.abs(true) < (SHAPE[1] / 2 - 8, SHAPE[0] / 2 - 8)).all(axis=1)
        errors.append(np.hypot(*(found[:, :2] / found[:, 2:] - true)[seen].T))
    return np.concatenate(errors)


@pytest.fixture(scope='module')
def suburb():
    """Houses that are near and rich: much of the frame is not the ground."""
    style = Style(houses=5, roof_depth=(0.7, 0.8), crowns=3, roads=0.0, texture=0.5)
    return aerial_scene(SHAPE, np.random.default_rng(8), style=style)


@pytest.fixture(scope='module')
def suburb_case(suburb):
    hover = Hover(24.0, 8.0, 50.0, 6e-5, phase=0.4)
    rng = np.random.default_rng(1)
    reference = reference_image(suburb, REAL, rng)
    objects = placed_objects(suburb, 1, np.random.default_rng(5))
    lives = [
        live_frame(
            suburb, new, GRID, lambda times: hover.poses(1.0, times), ShutterTiming(50.0), REAL, rng
        )
        for new in ((), objects)
    ]
    return reference, reference_depth(suburb), lives


def test_depth_of_a_scene_is_that_of_its_nearest_sheet(suburb):
    depth = reference_depth(suburb)
    layer = suburb.layers[-1]
    middle = int(layer.y) + layer.cover.shape[0] // 2, int(layer.x) + layer.cover.shape[1] // 2
    assert depth[middle] == np.float32(layer.relative_depth)
    assert (depth == 1.0).mean() > 0.5
    assert depth.shape == suburb.shape


def test_known_depths_register_better_and_need_no_search(suburb_case):
    reference, depth, ((live, truth), _) = suburb_case
    without = Detector(reference, CAMERA).detect(live)
    result = Detector(reference, CAMERA, depth=depth).detect(live)
    assert result.status == 'registered'
    errors, rival = _row_errors(result, truth), _row_errors(without, truth)
    assert np.median(errors) < 0.06
    assert np.percentile(errors, 90) < 0.1
    assert np.sqrt(np.mean(errors**2)) < 0.7 * np.sqrt(np.mean(rival**2))
    assert not result.regions, 'neither an alarm nor a house: its depth is no news'
    assert not any('layers' in step for step in result.timings_ms)
    known = result.valid_mask > 0
    misfit = luma(result.registered) - luma(np.rint(truth.clean).astype(np.uint8))
    rims = luma(without.registered) - luma(np.rint(truth.clean).astype(np.uint8))
    assert np.sqrt(np.mean(misfit[known] ** 2)) < 4.0  # noise and JPEG of the reference: 2 to 3
    assert np.abs(misfit[known]).mean() < np.abs(rims[known]).mean()


def test_new_objects_are_found_between_known_houses(suburb_case):
    reference, depth, (_, (live, truth)) = suburb_case
    result = Detector(reference, CAMERA, depth=depth).detect(live)
    assert len(result.changes) == len(result.regions) == 1
    changed, truly = result.change_mask > 0, truth.label == CHANGED
    assert np.count_nonzero(changed & truly) / np.count_nonzero(changed | truly) > 0.7


def test_uncovered_ground_is_not_judged(suburb_case):
    """Where the live frame sees past a house's edge, and the reference did not (M, N)."""
    reference, depth, ((live, truth), _) = suburb_case
    result = Detector(reference, CAMERA, depth=depth).detect(live)
    places = np.rint(truth.places).astype(int)
    inside = ((places >= 0) & (places < (SHAPE[1], SHAPE[0]))).all(axis=-1)
    x, y = np.clip(places, 0, (SHAPE[1] - 1, SHAPE[0] - 1)).transpose(2, 0, 1)
    hidden = inside & (truth.layers == 0) & (depth[y, x] < 1.0)  # ground now, a roof then
    assert np.count_nonzero(hidden) > 500
    assert np.mean(result.valid_mask[hidden] > 0) < 0.01
    assert np.mean(result.valid_mask[inside & ~hidden] > 0) > 0.8


def test_rectified_houses_lie_where_the_reference_has_them(suburb, suburb_case):
    reference, depth, ((live, _), _) = suburb_case
    result = Detector(reference, CAMERA, depth=depth).detect(live)
    plain = Detector(reference, CAMERA).detect(live)
    roofs = cv2.erode((depth < 0.9).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0

    def likeness(image):
        seen = roofs & (image > 0).all(axis=2)
        assert np.count_nonzero(seen) > 5000
        return np.corrcoef(luma(image)[seen], luma(reference)[seen])[0, 1]

    assert likeness(result.rectified) > 0.75  # it is blurred by 8 px
    assert likeness(result.rectified) > likeness(plain.rectified) + 0.1
    # the houses stand to the side of where they were and hide other ground: no second image of
    # them there
    hidden = ~roofs & (plain.rectified > 0).all(axis=2) & (result.rectified == 0).all(axis=2)
    assert 500 < np.count_nonzero(hidden) < 0.1 * hidden.size


def test_edges_of_the_map_may_be_two_pixels_off(suburb_case):
    reference, depth, ((live, truth), _) = suburb_case
    larger = cv2.erode(depth, np.ones((5, 5), np.uint8))  # nearer is less: houses grow by 2 px
    for wrong in (np.roll(depth, 2, axis=1), larger):
        result = Detector(reference, CAMERA, depth=wrong).detect(live)
        assert not result.changes
        assert np.percentile(_row_errors(result, truth), 90) < 0.12


def test_what_has_no_depth_is_never_judged(suburb, suburb_case):
    reference, depth, (_, (live, truth)) = suburb_case
    holes = depth.copy()
    layer = suburb.layers[-1]
    top, left = max(int(layer.y), 0), max(int(layer.x), 0)
    holes[top : top + layer.cover.shape[0], left : left + layer.cover.shape[1]] = np.nan
    result = Detector(reference, CAMERA, depth=holes).detect(live)
    house = truth.layers == len(suburb.layers)
    assert np.count_nonzero(house) > 1000
    assert not result.valid_mask[house].any()
    assert len(result.changes) == 1
    assert np.percentile(_row_errors(result, truth), 90) < 0.12


def test_a_map_that_says_flat_is_no_map(texture_of):
    texture = texture_of(320, 400, 3)
    reference, live = texture[40:280, 40:360].copy(), texture[46:286, 31:351].copy()
    flat = np.ones(reference.shape, np.float32)
    plain = Detector(reference).detect(live)
    result = Detector(reference, depth=flat).detect(live)
    np.testing.assert_allclose(result.row_motion[:, :2], plain.row_motion[:, :2], atol=0.02)
    differ = result.residual[result.valid_mask > 0] - plain.residual[result.valid_mask > 0]
    assert np.abs(differ).mean() < 0.2
    assert np.mean(result.valid_mask != plain.valid_mask) < 0.01


def test_sloping_ground_is_no_tilt_of_the_camera(texture_of):
    """Translation along a slope zooms the image; the map tells it from a camera that rises."""
    rows, cols, t_x, per_px = 240, 320, 20.0, 1.2e-3
    texture = texture_of(320, 480, 6)
    reference = texture[40:280, 80:400].copy()
    # 1/d = 1 + per_px x in the live frame, so x goes to x + t_x (1 + per_px x)
    center = (cols - 1) / 2
    scale = 1.0 + t_x * per_px
    warp = np.array([[scale, 0.0, 80.0 + t_x + center - scale * center], [0.0, 1.0, 40.0]])
    live = cv2.warpAffine(texture, warp, (cols, rows), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    x = (np.arange(cols) - center - t_x) / scale  # of the live frame, for reference columns
    depth = np.tile((1.0 / (1.0 + per_px * x)).astype(np.float32), (rows, 1))
    result = Detector(reference, Camera(300.0), depth=depth).detect(live)
    plain = Detector(reference, Camera(300.0)).detect(live)
    middle = slice(20, -20)
    t_found, s_found = result.row_motion[middle, 0], result.row_motion[middle, 3]
    np.testing.assert_allclose(np.median(t_found), t_x, atol=0.3)
    np.testing.assert_allclose(np.median(s_found), 1.0, atol=2e-3)
    assert abs(np.median(plain.row_motion[middle, 3]) - 1.0) > 5e-3, 'it would be taken for a rise'
    assert not result.changes
    assert (result.valid_mask > 0).mean() > 0.8


def test_depths_may_be_given_in_double_precision():
    assert checked_depth(np.ones((40, 40)), (40, 40, 3)).dtype == np.float32
