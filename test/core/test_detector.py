"""Forward model in, parameters and changes out: accuracy in pixels with a camera's nuisances on."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from row_places import row_errors, row_places

from rsmb_ros.core import (
    NOT_REGISTERED,
    REGISTERED,
    Camera,
    Config,
    ConfigError,
    Detector,
    FrameError,
)
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.path_fit import row_uncertainty
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    CHANGED,
    NEW,
    Nuisances,
    Scene,
    Sheet,
    aerial_scene,
    live_frame,
    placed_objects,
    reference_image,
)
from rsmb_ros.core.synthesis.paths import Hover

SHAPE = (240, 320)
CAMERA = Camera(300.0)
HOLD = Config.from_mapping({'stream.hold': True})
REAL = Nuisances(gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)


@dataclass(frozen=True)
class Case:
    reference: np.ndarray
    live: np.ndarray
    truth: object
    grid: Grid


def case(texture, objects=(), offset=14.0, blur=6.0, exposure=30.0, nuisances=REAL, **timing):
    """One live frame of a hovering drone over a planar texture or a whole scene."""
    scene = texture if isinstance(texture, Scene) else Scene(texture, margin=40)
    grid = Grid(SHAPE, scene.shape, CAMERA.focal_px)
    hover = Hover(offset, blur, exposure, line_delay=6e-5, phase=0.7)
    rng = np.random.default_rng(42)
    reference = reference_image(scene, nuisances, rng)
    live, truth = live_frame(
        scene,
        objects,
        grid,
        lambda times: hover.poses(0.0, times),
        ShutterTiming(exposure, **timing),
        nuisances,
        rng,
    )
    return Case(reference, live, truth, grid)


def errors(found: Case, result) -> np.ndarray:
    """Distance between found and true place of three points of each row (M * 3,) [px]."""
    poses = result.row_motion, found.truth.centroids
    return np.concatenate([row_errors(*poses, found.grid, x) for x in (-120.0, 0.0, 120.0)])


@pytest.fixture(scope='module')
def texture(texture_of):
    return texture_of(SHAPE[0] + 80, SHAPE[1] + 80, 21)


@pytest.mark.parametrize(
    ('regime', 'blur', 'exposure', 'rolling'),
    [
        ('rolling shutter and blur', 6.0, 30.0, True),
        ('rolling shutter, sharp', 0.4, 2.0, True),
        ('global shutter and blur', 6.0, 30.0, False),
        ('global shutter, sharp', 0.4, 2.0, False),
    ],
)
def test_rows_are_found_to_a_tenth_of_a_pixel_in_all_regimes(
    texture, regime, blur, exposure, rolling
):
    found = case(texture, blur=blur, exposure=exposure, rolling=rolling)
    config = Config.from_mapping({'shutter.exposure_rows': exposure})
    result = Detector(found.reference, CAMERA, config).detect(found.live)
    assert result.status == 'registered', regime
    if rolling:
        off = errors(found, result)
        assert np.median(off) < 0.05
        assert np.percentile(off, 90) < 0.1
    known = result.valid_mask > 0
    misfit = (result.registered.astype(float) - found.truth.clean)[known]
    assert np.sqrt(np.mean(misfit**2)) < 4.0  # noise and JPEG of the reference: 2 to 3
    assert not result.changes


@pytest.mark.parametrize('exposure', [12.0, 30.0, 70.0])
def test_exposure_is_self_calibrated(texture, exposure):
    found = case(texture, blur=exposure / 5.0, exposure=exposure)
    result = Detector(found.reference, CAMERA).detect(found.live)
    # the image moves by 0.2 px per row: right to half a pixel of blur
    assert 0.2 * abs(result.exposure_rows - exposure) < 0.55
    assert np.median(errors(found, result)) < 0.06


def test_offset_of_a_quarter_frame_is_found(texture_of):
    texture = texture_of(SHAPE[0] + 200, SHAPE[1] + 200, 22)
    scene = Scene(texture, margin=100)
    found = case(scene, offset=64.0)
    result = Detector(found.reference, CAMERA).detect(found.live)
    assert np.median(errors(found, result)) < 0.06


def test_bottom_up_readout_is_a_parameter(texture):
    found = case(texture, bottom_up=True)
    config = Config.from_mapping({'shutter': {'exposure_rows': 30.0, 'readout': 'bottom_up'}})
    result = Detector(found.reference, CAMERA, config).detect(found.live)
    assert np.median(errors(found, result)) < 0.05


def test_stated_uncertainty_is_of_the_size_of_the_error(texture):
    found = case(texture)
    result = Detector(found.reference, CAMERA).detect(found.live)
    centre = errors(found, result)[SHAPE[0] : 2 * SHAPE[0]]
    ratio = np.sqrt(np.mean(centre**2)) / np.sqrt(np.mean(result.row_uncertainty**2))
    assert 0.2 < ratio < 3.0


@pytest.mark.parametrize('shape', [(32, 2000), (2000, 32), (32, 32)])
def test_a_narrow_strip_is_a_result_not_an_exception(texture_of, shape):
    image = texture_of(shape[0] + 4, shape[1] + 4, 5)
    result = Detector(image[2:-2, 2:-2]).detect(image[2:-2, 3:-1])
    assert result.status in (REGISTERED, NOT_REGISTERED)
    assert result.change_mask.shape == result.valid_mask.shape == shape
    assert len(result.row_uncertainty) == shape[0]


def test_rows_that_show_little_but_noise_are_less_certain_than_the_fit_says(texture):
    bare = texture.astype(np.float32)
    bare[130:210] = 110.0 + 0.015 * (bare[130:210] - 110.0)  # rows 90 to 170 of the frame
    found = case(bare)
    result = Detector(found.reference, CAMERA).detect(found.live)
    factors = result.row_uncertainty / row_uncertainty(result.views.fit)
    assert factors[112:144].min() > 2.0
    np.testing.assert_allclose(factors[[*range(64), *range(192, 240)]], 1.0)


def test_reference_may_be_larger_than_the_frame(texture_of):
    texture = texture_of(500, 640, 23)
    scene = Scene(texture, margin=40)  # reference 420 x 560, frame 240 x 320 in its middle
    found = case(scene)
    result = Detector(found.reference, CAMERA).detect(found.live)
    assert result.status == 'registered'
    assert np.median(errors(found, result)) < 0.06
    assert result.rectified.shape == (420, 560)
    assert result.valid_mask.mean() > 240


@pytest.fixture(scope='module')
def suburb():
    return aerial_scene((480, 640), np.random.default_rng(3))


@pytest.fixture(scope='module')
def suburb_case(suburb):
    grid = Grid((480, 640), (480, 640), 576.0)
    hover = Hover(22.0, 8.0, 50.0, 6e-5, phase=0.4)
    rng = np.random.default_rng(1)
    reference = reference_image(suburb, REAL, rng)

    def frame(objects):
        return live_frame(
            suburb,
            objects,
            grid,
            lambda times: hover.poses(1.0, times),
            ShutterTiming(50.0),
            REAL,
            rng,
        )

    return reference, frame


def test_new_objects_are_found_and_houses_are_not(suburb, suburb_case):
    reference, frame = suburb_case
    live, truth = frame(placed_objects(suburb, 2, np.random.default_rng(4)))
    result = Detector(reference).detect(live)
    assert len(result.changes) == 2
    for x, y, width, height in truth.boxes.values():
        middle = (x + width / 2, y + height / 2)
        hits = [
            region
            for region in result.changes
            if region.x <= middle[0] < region.x + region.width
            and region.y <= middle[1] < region.y + region.height
        ]
        assert len(hits) == 1
        assert hits[0].score > 0.8
    changed = result.change_mask > 0
    truly = truth.label == CHANGED
    assert np.count_nonzero(changed & truly) / np.count_nonzero(truly) > 0.9
    assert result.change_mask.dtype == result.valid_mask.dtype == np.uint8
    assert set(np.unique(result.change_mask)) <= {0, 255}


def test_unchanged_scene_with_parallax_raises_no_alarm(suburb, suburb_case):
    reference, frame = suburb_case
    live, _ = frame(())
    result = Detector(reference).detect(live)
    assert result.status == 'registered'
    assert not result.changes
    depths = [region.relative_depth for region in result.regions]
    assert depths, 'the houses move by 3 px and must be seen as static objects'
    true = [layer.relative_depth for layer in suburb.layers]
    assert all(min(abs(depth - one) for one in true) < 0.03 for depth in depths)


def test_results_do_not_depend_on_the_number_of_threads(texture):
    found = case(texture)
    results = [
        Detector(found.reference, CAMERA, Config.from_mapping({'worker.threads': n})).detect(
            found.live
        )
        for n in (1, 2, 3)
    ]
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].residual, other.residual)
        np.testing.assert_array_equal(results[0].row_motion, other.row_motion)
        np.testing.assert_array_equal(results[0].change_mask, other.change_mask)


def test_colour_and_grey_are_registered_alike(suburb, suburb_case):
    reference, frame = suburb_case
    live, _ = frame(())
    result = Detector(reference).detect(live)
    assert result.registered.shape == live.shape
    assert result.rectified.shape == reference.shape
    inside = result.valid_mask > 0
    misfit = (result.registered.astype(float) - live)[inside]
    assert np.sqrt(np.mean(misfit**2)) < 12.0
    level = Detector(reference[..., 1].copy()).detect(live[..., 1].copy())
    grid = Grid((480, 640), (480, 640), 576.0)
    apart = row_places(level.row_motion, grid, 0.0) - row_places(result.row_motion, grid, 0.0)
    assert np.percentile(np.hypot(*apart.T), 95) < 0.2  # px: another channel, other noise


def test_rectified_frame_lies_on_the_reference(texture):
    found = case(texture, blur=0.5, exposure=2.0)
    result = Detector(found.reference, CAMERA).detect(found.live)
    seen = result.rectified > 0
    seen[:8] = seen[-8:] = False
    assert seen.mean() > 0.75
    gain = found.live.mean() / found.reference.mean()
    difference = result.rectified[seen] / gain - found.reference[seen]
    assert np.median(np.abs(difference)) < 5.0
    shifted = np.abs(np.roll(result.rectified, 3, axis=1)[seen] / gain - found.reference[seen])
    assert np.median(shifted) > 2 * np.median(np.abs(difference))


@pytest.mark.parametrize(
    ('live', 'reason'),
    [
        (np.full(SHAPE, 90, np.uint8), 'no texture in the live frame'),
        ('other', 'match|overlap'),
        (np.random.default_rng(0).integers(0, 255, SHAPE, dtype=np.uint8), 'match|overlap'),
    ],
)
def test_hopeless_frames_are_a_result_with_a_reason(texture, texture_of, live, reason):
    if isinstance(live, str):
        live = texture_of(*SHAPE, 99)
    result = Detector(texture, CAMERA).detect(live)
    assert result.status == 'not_registered'
    assert re.search(reason, result.reason)
    assert not result.valid_mask.any()
    assert not result.change_mask.any()
    assert np.isnan(result.row_motion).all()
    assert result.registered.shape == SHAPE
    assert result.rectified.shape == texture.shape


def test_flat_reference_is_a_result_too(texture):
    result = Detector(np.full(SHAPE, 7, np.uint8)).detect(texture[: SHAPE[0], : SHAPE[1]].copy())
    assert result.status == 'not_registered'
    assert 'no texture in the reference' in result.reason


@pytest.mark.parametrize(
    'image',
    [
        np.zeros((100, 100), np.float32),
        np.zeros((100, 100, 4), np.uint8),
        np.zeros((8, 100), np.uint8),
        'a path',
        None,
    ],
)
def test_what_is_no_image_is_refused_with_its_shape(image, texture):
    with pytest.raises(FrameError, match='reference is'):
        Detector(image)
    with pytest.raises(FrameError, match='live frame is'):
        Detector(texture).detect(image)


def test_stream_may_change_its_size(texture):
    detector = Detector(texture, CAMERA)
    first = detector.detect(texture[:200, :260].copy())
    second = detector.detect(texture[40:280, 30:350].copy())
    assert [result.status for result in (first, second)] == ['registered'] * 2
    np.testing.assert_allclose(np.median(second.row_motion[:, 0]), -10.0, atol=0.2)
    np.testing.assert_allclose(np.median(second.row_motion[:, 1]), 0.0, atol=0.2)


def stream(texture, frames, exposure=30.0, still=None, **options):
    """Live frames of a drone that hovers; `still` frames show nothing known."""
    scene = Scene(texture, margin=40)
    grid = Grid(SHAPE, scene.shape, CAMERA.focal_px)
    hover = Hover(14.0, 6.0, exposure, line_delay=6e-5, phase=0.7)
    rng = np.random.default_rng(43)
    yield reference_image(scene, REAL, rng)
    for n in range(frames):
        start = 0.3 * n
        live, truth = live_frame(
            scene, (), grid, lambda rows, t=start: hover.poses(t, rows),
            ShutterTiming(exposure), REAL, rng,
        )  # fmt: skip
        yield Case(None, live, truth, grid)


def test_stream_holds_its_exposure_and_finds_each_frame_from_the_last(texture):
    frames = stream(texture, 13)
    detector = Detector(next(frames), CAMERA, HOLD)
    results = [(frame, detector.detect(frame.live)) for frame in frames]
    assert all(np.median(errors(frame, result)) < 0.06 for frame, result in results)
    held = [result.exposure_rows for _, result in results[10:]]
    assert np.ptp(held) < 0.2  # no longer looked for in each frame, but corrected by all
    # the simulator's interpolation, taken for defocus, hides some of a blur of 6 px
    np.testing.assert_allclose(held, 30.0, rtol=0.04)


def test_frame_after_a_gap_is_found_again(texture, texture_of):
    """A frame of something else: the next one starts from nothing."""
    frames = stream(texture, 3)
    detector = Detector(next(frames), CAMERA, HOLD)
    first, second, _ = frames
    assert detector.detect(first.live).status == 'registered'
    assert detector.detect(texture_of(*SHAPE, 77)).status == 'not_registered'
    assert np.median(errors(second, detector.detect(second.live))) < 0.06


def test_exposure_that_is_changed_in_flight_is_noticed(texture):
    frames = stream(texture, 12)
    detector = Detector(next(frames), CAMERA, HOLD)
    for frame in frames:
        detector.detect(frame.live)
    longer = stream(texture, 3, exposure=60.0)
    next(longer)
    found = [detector.detect(frame.live).exposure_rows for frame in longer]
    np.testing.assert_allclose(found[-1], 60.0, rtol=0.08)


def test_without_memory_each_frame_stands_alone(texture):
    frames = stream(texture, 3)
    reference = next(frames)
    detector = Detector(reference, CAMERA)
    for frame in frames:
        result = detector.detect(frame.live)
        expected = Detector(reference, CAMERA).detect(frame.live)
        np.testing.assert_array_equal(result.row_motion, expected.row_motion)
        np.testing.assert_array_equal(result.residual, expected.residual)


def test_equal_streams_give_equal_results(texture):
    reference, *frames = stream(texture, 4)
    one, other = (Detector(reference, CAMERA, HOLD) for _ in range(2))
    for frame in frames:
        np.testing.assert_array_equal(
            one.detect(frame.live).residual, other.detect(frame.live).residual
        )


@pytest.mark.parametrize('defocus', [0.0, 0.5, 0.9])
def test_defocus_is_not_taken_for_exposure(texture, defocus):
    """A sharp frame through a soft lens: no exposure may be made up for it."""
    soft = replace(REAL, defocus_px=defocus)
    found = case(texture, blur=0.5, exposure=10.0, nuisances=soft)
    detector = Detector(found.reference, CAMERA)
    result = detector.detect(found.live)
    assert np.median(errors(found, result)) < 0.06
    blur = 0.05 * result.exposure_rows  # px
    assert blur < 1.4
    np.testing.assert_allclose(result.views.fit.defocus, defocus**2 + 0.1, atol=0.2)


def test_results_do_not_depend_on_where_arrays_lie(texture):
    """Equal input, equal bits: memory that is laid out differently must not reorder a sum."""
    found = case(texture)
    hold, results = [], []
    for n in range(4):
        hold.append([np.empty(1001 * n + 7, np.uint8) for _ in range(5 * n)])
        results.append(Detector(found.reference.copy(), CAMERA).detect(found.live.copy()))
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].residual, other.residual)
        np.testing.assert_array_equal(results[0].row_motion, other.row_motion)


def test_rows_alone_are_registered_as_the_report_does(texture):
    found = case(texture, blur=2.0, exposure=7.0, nuisances=Nuisances(gamma=1.0))
    config = {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 3}
    result = Detector(found.reference, CAMERA, Config.from_mapping(config)).detect(found.live)
    assert result.status == 'registered'
    assert np.isnan(result.exposure_rows)
    assert np.isnan(result.row_uncertainty).all()
    assert 0.9 < result.gain < 1.1
    assert np.median(errors(found, result)) < 0.15  # rows alone: the report has 0.2 px
    known = result.valid_mask > 0
    misfit = (result.registered.astype(float) - found.truth.clean)[known]
    assert np.sqrt(np.mean(misfit**2)) < 2.0
    assert not result.changes


def test_rows_alone_find_a_new_object(texture):
    patch = Sheet(
        np.full((40, 50), 250, np.uint8), np.ones((40, 50), np.float32), 180, 90, kind=NEW
    )
    found = case(texture, (patch,), blur=2.0, exposure=7.0, nuisances=Nuisances(gamma=1.0))
    config = {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 2}
    result = Detector(found.reference, CAMERA, Config.from_mapping(config)).detect(found.live)
    changed, truly = result.change_mask > 0, found.truth.label == CHANGED
    assert np.count_nonzero(changed & truly) / np.count_nonzero(changed | truly) > 0.7


def test_four_degrees_of_freedom_are_not_for_rows():
    with pytest.raises(ConfigError, match='must be 2, 3 or 6'):
        Config.from_mapping(
            {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 4}
        )


def test_white_that_both_exposures_clip_is_no_change(texture):
    """What the reference clips may be anything brighter: a darker exposure shows how bright."""
    white = np.clip(texture.astype(int), 0, 180).astype(np.uint8)
    white[110:140, 150:200] = 250
    camera = Nuisances(gain=0.6, overexposure=1.5, noise_electrons=9000, jpeg_quality=92)
    found = case(white, nuisances=camera)
    assert (found.reference[75:95, 115:155] >= 250).mean() > 0.9
    result = Detector(found.reference, CAMERA).detect(found.live)
    assert result.status == 'registered'
    assert not result.changes
