"""Suites: the same bytes every time, and what their names promise."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.core.motion import Grid, coordinates_from_poses, homographies
from rsmb_ros.core.synthesis import live_frame, reference_image
from rsmb_ros.core.synthesis.exposure import row_instants
from rsmb_ros.evaluation.suites import SUITES, Wish, real, recipe
from rsmb_ros.evaluation.suites.nuisances import (
    ALL,
    LINEAR,
    NONE,
    OTHER_TONES,
    STRONG_LIGHT,
    described,
    drawn,
)
from rsmb_ros.evaluation.suites.real import MIN_VEHICLE, RIM_PX, vehicles
from rsmb_ros.evaluation.suites.recipe import REGIMES, Recipe, fly, margin_of
from rsmb_ros.evaluation.suites.suite import seeded

SMALL = (240, 320)  # rows, cols
NAMES = (
    'quick planar layered regimes far light tones weak-texture big-change nochange authors photos '
    'video'
)


def cases_of(suite, first, **wish):
    return list(SUITES[suite].cases(Wish(first=first, **{'shape': SMALL, **wish})))


def bytes_of(case):
    arrays = [case.reference, case.live, case.label, case.objects]
    arrays += [case.motion.places, case.motion.layers, case.motion.clean]
    return [array.tobytes() for array in arrays]


def told(case, name):
    """Return what a case says it was made with."""
    return case.about[name]


# -- all suites ----------------------------------------------------------------------------------


def test_suites_are_these():
    assert list(SUITES) == NAMES.split()
    assert all(suite.name == name for name, suite in SUITES.items())


def test_every_suite_says_what_it_is_and_how_often_nuisances_occur():
    for suite in SUITES.values():
        assert suite.about
        assert suite.frequencies
        assert all(suite.frequencies)


@pytest.fixture(scope='module')
def quick():
    """Return all cases of `quick`."""
    return list(SUITES['quick'].cases(Wish()))


def test_suite_has_as_many_cases_as_it_says(quick):
    assert [case.name for case in quick] == [f'quick/{n:02d}' for n in range(SUITES['quick'].size)]


def test_equal_wishes_give_equal_bytes(quick):
    one, same = quick, list(SUITES['quick'].cases(Wish()))
    assert [bytes_of(case) for case in one] == [bytes_of(case) for case in same]
    assert [case.about for case in one] == [case.about for case in same]
    assert len({case.live.tobytes() for case in one}) == len(one)


def test_bytes_do_not_depend_on_threads(quick, monkeypatch):
    for function in (live_frame, reference_image):
        monkeypatch.setattr(recipe, function.__name__, partial(function, threads=1))
    alone = cases_of('quick', 2)
    assert [bytes_of(case) for case in alone] == [bytes_of(case) for case in quick[:2]]


def test_size_and_nuisances_are_as_wished():
    (case,) = cases_of('planar', 1, shape=(256, 336), nuisances='none')
    assert case.reference.shape == case.live.shape == (256, 336, 3)
    assert told(case, 'nuisances') == drawn(NONE, seeded('any', 0)).as_dict()
    (case,) = cases_of('authors', 1, nuisances='all')
    assert told(case, 'nuisances')['noise_electrons'] is not None


# -- what the names promise ----------------------------------------------------------------------


def test_nothing_has_changed_in_nochange():
    assert SUITES['nochange'].size >= 30
    for case in cases_of('nochange', 6):  # each of its recipes once
        assert not case.changed
        assert not np.isin(case.label, (170, 255)).any()


def test_big_change_covers_30_to_50_percent_of_the_width():
    for case in cases_of('big-change', 8):
        number = told(case, 'objects').index('large object') + 1
        mask = case.objects == number
        rows = mask.sum(axis=1)
        # zoom, turns and sway change it by 3 %; an edge may cut it: placed 4 % from it, the frame
        # lies up to 5 % of its width off
        assert 0.27 < np.median(rows[rows > 0]) / SMALL[1] < 0.53
        assert 0.25 - 0.06 < np.count_nonzero(rows) / SMALL[0] < 0.53


def test_far_is_10_to_20_percent_of_the_width_away():
    found = np.array([told(case, 'offset') for case in cases_of('far', 6)])
    shares = np.hypot(found[:, 0], found[:, 1]) / SMALL[1]
    assert 0.1 <= shares.min() < shares.max() <= 0.2
    assert np.abs(found[:, 2]).max() <= 5  # deg
    assert np.abs(found[:, 3] - 1).max() <= 0.05


def test_far_is_true_of_the_places():
    (case,) = cases_of('far', 1)
    y, x = np.mgrid[: SMALL[0], : SMALL[1]]
    moved = case.motion.places - np.dstack([x, y])
    share = np.linalg.norm(moved.mean(axis=(0, 1))) / SMALL[1]
    assert 0.08 < share < 0.22  # its motion during the frame comes on top


def test_regimes_take_turns():
    cases = cases_of('regimes', 8)
    regimes = [told(case, 'regime') for case in cases]
    assert regimes == [name for name in REGIMES for _ in ('flat', 'layered')]
    for case, regime in zip(cases, regimes, strict=True):
        rolling, blurred = REGIMES[regime]
        centroids = case.motion.centroids
        assert (case.motion.exposure_rows > 0) == blurred
        assert bool(np.ptp(centroids[:, :2], axis=0).max() > 0.1) == rolling  # px
    assert [bool(case.motion.depths) for case in cases] == [False, True] * 4


def test_authors_sum_intensities_as_they_are():
    """And the detector is told so."""
    (case,) = cases_of('authors', 1)
    assert told(case, 'nuisances') == drawn(LINEAR, seeded('any', 0)).as_dict()
    assert told(case, 'nuisances')['gamma'] == 1.0 == SUITES['authors'].settings['camera.gamma']
    assert case.motion.exposure_rows == pytest.approx(20 / 3)  # a / b


def test_authors_motion_classes_are_in_the_names():
    names = [case.name for case in cases_of('authors', 3)]
    groups = ('motion 2D uniform', 'motion 2D nonuniform', 'motion 3D uniform')
    assert names == [f'authors/{group}/{n:02d}' for n, group in enumerate(groups)]


def test_weak_texture_has_little_of_it():
    contrasts = {
        suite: np.median([case.reference.mean(axis=2).std() for case in cases_of(suite, 4)])
        for suite in ('weak-texture', 'planar')
    }
    assert contrasts['weak-texture'] < 0.5 * contrasts['planar']


# -- nuisances -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'ranges',
    [ALL, STRONG_LIGHT, OTHER_TONES, LINEAR],
    ids=['all', 'light', 'tones', 'linear'],
)
def test_nuisances_stay_in_range_and_are_as_frequent_as_said(ranges):
    count = 400
    rng = np.random.default_rng(20170301)
    found = [vars(drawn(ranges, rng)) for _ in range(count)]
    usual = vars(drawn(NONE, rng))
    for name, value in usual.items():
        drawn_ones = [one[name] for one in found if one[name] != value]
        share, low, high = ranges.get(name, (0.0, value, value))
        assert all(low <= one <= high for one in drawn_ones), name
        # four standard deviations of a share of 400
        spread = 4 * np.sqrt(share * (1 - share) / count)
        assert abs(len(drawn_ones) / count - share) <= spread, name


def test_description_names_every_nuisance():
    for ranges in (ALL, STRONG_LIGHT, OTHER_TONES):
        text = described(ranges)
        assert all(name in text for name in ranges)
        assert 'overexposure 1.1 to 1.6 in 25%' in described(ALL)
    assert described(NONE).startswith('no nuisances')
    assert described(LINEAR) != described(NONE)


# -- margin --------------------------------------------------------------------------------------


@pytest.mark.parametrize('motion', ['smooth', 'jello', 'walk', 'constant'])
@pytest.mark.parametrize(
    'made_of',
    [
        Recipe(),
        Recipe(offset=(0.1, 0.2), rotation_deg=(0.0, 5.0), zoom=(0.0, 0.05)),
        Recipe(blur_px=(24.0, 24.0), regimes=('RSMB', 'RS', 'GSMB', 'GS')),
        Recipe(stairs=(20, 3), sway_px=(5.0, 20.0)),
    ],
    ids=['usual', 'far', 'regimes', 'stairs'],
)
def test_margin_holds_all_ground_that_is_seen(made_of, motion):
    """All corners of all rows at all instants, with the strongest distortion of `ALL`."""
    grid = Grid(SMALL, SMALL, Camera.guess(SMALL[1]).focal_px)
    stretch = 1 + ALL['distortion'].high * (grid.center[:2] ** 2).sum() / grid.half_width**2
    for number in range(8):
        rng = np.random.default_rng([5, number])
        flown = fly(replace(made_of, motions=(motion,)), SMALL, number, rng)
        margin = margin_of(flown, grid)
        poses = row_instants(flown.path, flown.timing, SMALL[0], flown.instants)
        rows = np.repeat(np.arange(SMALL[0]), [len(row) for row in poses])
        hs = homographies(coordinates_from_poses(np.concatenate(poses), grid), grid)
        y = (rows - grid.center[1]) * stretch
        for x in (-grid.center[0] * stretch, grid.center[0] * stretch):
            points = hs @ np.stack([np.full_like(y, x), y, np.ones_like(y)], axis=1)[..., None]
            places = points[:, :2, 0] / points[:, 2:, 0] + grid.center[2:]
            last = np.array(SMALL[::-1]) - 1
            # 1 px: the neighbours cubic sampling needs
            assert (places >= 1 - margin).all()
            assert (places <= last + margin - 1).all()


# -- real pictures -------------------------------------------------------------------------------


def test_vehicle_is_what_differs():
    reference = np.full((120, 160, 3), 90, np.uint8)
    frame = reference.copy()
    frame[40:60, 70:100] = (90, 90, 200)
    doubt, car = vehicles(reference, frame)
    assert (car.name, car.shadow, doubt.shadow) == ('vehicle 1', False, True)
    x, y, width, height = cv2.boundingRect((car.cover > 0).astype(np.uint8))
    # smoothing and closing move an edge by up to two pixels
    np.testing.assert_allclose((x, y, x + width, y + height), (70, 40, 100, 60), atol=2)
    assert not np.any((car.cover > 0) & (doubt.cover > 0))
    around = cv2.dilate(car.cover, np.ones((3, 3))) - car.cover
    assert doubt.cover[around > 0].all()  # its rim counts neither way
    assert not doubt.cover[:, : 70 - 4 * RIM_PX].any()
    np.testing.assert_array_equal(car.texture, frame)


def test_equal_frames_hold_no_vehicle():
    frame = np.full((120, 160, 3), 90, np.uint8)
    (doubt,) = vehicles(frame, frame)
    assert not doubt.cover.any()


def test_what_is_small_or_faint_is_no_vehicle_but_in_doubt():
    reference = np.full((120, 160, 3), 90, np.uint8)
    frame = reference.copy()
    side = int(np.sqrt(MIN_VEHICLE)) - 3
    frame[20 : 20 + side, 20 : 20 + side] = 200  # small
    frame[60:90, 60:100] += 20  # faint
    (doubt,) = vehicles(reference, frame)
    assert doubt.cover[20 + side // 2, 20 + side // 2]
    assert doubt.cover[75, 80]


@pytest.mark.parametrize('suite', ['photos', 'video'])
def test_missing_pictures_are_named(suite, tmp_path):
    with pytest.raises(FileProblem, match=f'suite {suite} needs .*--data or RSMB_DATA'):
        SUITES[suite].check(Wish())
    with pytest.raises(FileProblem, match=f'{tmp_path}: suite {suite} needs .*, missing there: '):
        next(SUITES[suite].cases(Wish(data=tmp_path)))


def test_photos_are_ground_of_changed_cases(real_photos):
    cases = cases_of('photos', 2, data=real_photos.parent)
    assert [case.name for case in cases] == ['photos/00', 'photos/01']
    for case in cases:
        assert case.reference.shape == case.live.shape == (*SMALL, 3)
        assert case.changed == bool((case.label == 255).any())
    assert [bool(case.motion.depths) for case in cases] == [False, True]


def test_nothing_has_changed_in_the_real_revisit(real_photos, monkeypatch):
    monkeypatch.setattr(real, '_PHOTO_CASES', 0)  # those before it take seconds
    there, back = SUITES['photos'].cases(Wish(data=real_photos.parent))
    assert (there.name, back.name) == ('photos/9408-9425', 'photos/9425-9408')
    assert there.reference is back.live
    for case in (there, back):
        assert case.reference.shape == case.live.shape
        assert not case.changed
        assert not case.label.any()
        assert (case.motion, case.focal_px) == (None, None)


def test_video_frames_hold_vehicles_and_a_moving_camera(real_photos):
    cases = cases_of('video', 2, data=real_photos.parent)
    assert [case.name for case in cases] == ['video/040', 'video/060']
    for case in cases:
        assert case.reference.shape == case.live.shape == (360, 640, 3)
        assert case.changed == bool((case.label == 255).any())
        assert np.ptp(case.motion.centroids[:, :2]) > 0.1  # px
    assert [told(case, 'objects') for case in cases] == [[], ['vehicle 1']]  # empty at first


def test_video_reference_is_bent_by_nothing(real_photos):
    """Frame 0 is taken as it is: neither distorted nor clipped, with no nuisance asked for."""
    for nuisances in ('usual', 'all', 'none'):
        (case,) = cases_of('video', 1, data=real_photos.parent, nuisances=nuisances)
        assert told(case, 'nuisances')['distortion'] == 0.0
        assert told(case, 'nuisances')['overexposure'] == 1.0
