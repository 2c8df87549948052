"""Each figure against one computed by hand."""

import math

import numpy as np
import pytest

from rsmb_ros.evaluation.case import Case, TrueMotion
from rsmb_ros.evaluation.matching import TOUCH_PX
from rsmb_ros.evaluation.methods import Outcome, Registration
from rsmb_ros.evaluation.metrics import (
    LEFTOVER,
    ObjectScores,
    PixelScores,
    RegistrationScores,
    object_scores,
    pixel_scores,
    registration_scores,
    score,
)
from rsmb_ros.evaluation.true_path import TruePrediction

SHAPE = (120, 160)
LEFT_PX = math.ceil(LEFTOVER * SHAPE[0] * SHAPE[1])  # 5 px


def mask(*boxes):
    """Rectangles (row, col, rows, cols)."""
    drawn = np.zeros(SHAPE, bool)
    for row, col, rows, cols in boxes:
        drawn[row : row + rows, col : col + cols] = True
    return drawn


def truth(*boxes):
    """Label and numbers of objects."""
    objects = np.zeros(SHAPE, np.uint8)
    for n, box in enumerate(boxes):
        objects[mask(box)] = 3 * n + 2  # numbers need not begin at 1 or be dense
    return np.where(objects > 0, 255, 0).astype(np.uint8), objects


def places():
    """Every pixel lies where it is."""
    x, y = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    return np.stack([x, y], axis=-1).astype(np.float32)


def live_image():
    return np.random.default_rng(20170301).integers(20, 200, SHAPE, dtype=np.uint8)


def motion(**given):
    still = {
        'places': places(),
        'centroids': np.zeros((SHAPE[0], 6)),
        'layers': np.zeros(SHAPE, np.uint8),
        'depths': (),
        'exposure_rows': 40.0,
    }
    return TrueMotion(**{**still, **given})


def case(label=None, objects=None, **given):
    nothing = np.zeros(SHAPE, np.uint8)
    label, objects = (nothing if one is None else one for one in (label, objects))
    return Case('planar/07', live_image(), live_image(), label, objects, **given)


def registration(**given):
    perfect = {
        'registered': live_image().astype(np.float32),
        'inside': np.ones(SHAPE, bool),
        'places': places(),
    }
    return Registration(**{**perfect, **given})


def outcome(**given):
    perfect = {
        'registered': True,
        'reason': '',
        'change': mask(),
        'valid': ~mask(),
        'registration': registration(),
        'seconds': 0.5,
    }
    return Outcome(**{**perfect, **given})


# ---- pixels


def small_label(*values):
    return np.array([values], np.uint8)


def small_mask(*values):
    return np.array([values], bool)


def test_cdnet_figures_are_those_of_the_confusion_matrix():
    label = small_label(255, 255, 255, 0, 0, 0, 0, 0, 170, 85)  # tp 2, fn 1, fp 1, tn 4
    change = small_mask(1, 1, 0, 1, 0, 0, 0, 0, 1, 1)
    found = pixel_scores(change, np.ones_like(change), label)
    assert found == PixelScores(
        recall=2 / 3,
        specificity=4 / 5,
        fpr=1 / 5,
        fnr=1 / 3,
        pwc=25.0,
        precision=2 / 3,
        f=4 / 6,
        iou=2 / 4,
        judged=1.0,
    )


def test_pixel_that_is_not_judged_counts_as_not_changed():
    label = small_label(255, 255, 0, 0, 85)
    change = small_mask(1, 1, 1, 0, 0)
    valid = small_mask(1, 0, 0, 1, 0)
    found = pixel_scores(change, valid, label)
    assert (found.recall, found.precision, found.pwc) == (0.5, 1.0, 25.0)
    assert found.judged == 0.5  # of four: the one outside is nobody's to judge


def test_unchanged_case_has_no_recall_precision_f_or_iou():
    found = pixel_scores(small_mask(1, 0, 0, 0), small_mask(1, 1, 1, 1), small_label(0, 0, 0, 0))
    undefined = (found.recall, found.fnr, found.precision, found.f, found.iou)
    assert all(map(math.isnan, undefined))
    assert (found.specificity, found.fpr, found.pwc) == (0.75, 0.25, 25.0)


def test_reporting_nothing_of_a_change_gives_precision_and_f_0():
    found = pixel_scores(small_mask(0, 0), small_mask(1, 1), small_label(255, 0))
    assert (found.recall, found.precision, found.f, found.iou) == (0, 0, 0, 0)


def test_frame_changed_everywhere_has_no_specificity():
    found = pixel_scores(small_mask(1, 1), small_mask(1, 1), small_label(255, 255))
    assert math.isnan(found.specificity)
    assert math.isnan(found.fpr)
    assert found.f == 1.0


def test_frame_without_known_truth_has_no_figures():
    found = pixel_scores(small_mask(1, 1), small_mask(1, 1), small_label(85, 170))
    assert all(map(math.isnan, vars(found).values()))


# ---- objects

CAR, VAN = (20, 20, 20, 40), (80, 100, 20, 40)


def test_each_object_with_a_region_of_its_own_is_found():
    assert object_scores(mask(CAR, VAN), *truth(CAR, VAN), 0.5) == ObjectScores(2, 0, 0, 0)


@pytest.mark.parametrize(('min_iou', 'tp'), [(0.25, 1), (0.5, 1), (0.51, 0)])
def test_iou_counts_pixels_and_its_bound_is_included(min_iou, tp):
    half = mask((20, 20, 20, 20))  # 400 of 800 px
    assert object_scores(half, *truth(CAR), min_iou) == ObjectScores(tp, 1 - tp, 1 - tp, 0)


def test_split_object_is_found_once():
    parts = mask((20, 20, 20, 24), (20, 46, 20, 14))  # 480 and 280 of 800 px: IoU 0.6, 0.35
    assert object_scores(parts, *truth(CAR), 0.25) == ObjectScores(1, 1, 0, 0)


def test_two_merged_objects_are_one_region():
    near = (20, 62, 20, 40)
    both = mask((20, 20, 20, 82))  # 800 of 1640 px each: IoU 0.49
    assert object_scores(both, *truth(CAR, near), 0.25) == ObjectScores(1, 0, 1, 0)
    assert object_scores(both, *truth(CAR, near), 0.5) == ObjectScores(0, 1, 2, 0)


def test_as_many_pairs_as_possible_are_formed():
    wide, narrow = (20, 20, 20, 40), (20, 60, 20, 10)
    left, right = (20, 20, 20, 11), (20, 32, 20, 38)
    # left fits wide (IoU 0.28); right fits wide (0.56) better than narrow (0.26)
    found = object_scores(mask(left, right), *truth(wide, narrow), 0.25)
    assert found == ObjectScores(2, 0, 0, 0)


def test_regions_that_touch_at_a_corner_are_one():
    stairs = mask((20, 20, 10, 20), (30, 40, 10, 20))
    assert object_scores(stairs, *truth(), 0.5) == ObjectScores(0, 1, 0, 1)


def with_rim(box, rim=4):
    """Truth of one object whose outermost `rim` px are a rim."""
    label, objects = truth(box)
    row, col, rows, cols = box
    core = mask((row + rim, col + rim, rows - 2 * rim, cols - 2 * rim))
    label[(label == 255) & ~core] = 170
    return label, objects


@pytest.mark.parametrize('grown', [0, 2, 4])
def test_rim_belongs_to_nobody(grown):
    row, col, rows, cols = CAR
    inner = 4 - grown
    region = mask((row + inner, col + inner, rows - 2 * inner, cols - 2 * inner))
    assert object_scores(region, *with_rim(CAR), 1.0) == ObjectScores(1, 0, 0, 0)


def test_ring_around_the_rim_stays_a_part_of_its_region():
    region = mask((19, 19, 22, 42))  # 12 x 32 px of core and a ring of 124 px
    assert object_scores(region, *with_rim(CAR), 0.75) == ObjectScores(1, 0, 0, 0)
    assert object_scores(region, *with_rim(CAR), 0.76) == ObjectScores(0, 1, 1, 0)


def test_region_in_ignored_pixels_counts_nothing():
    label, objects = truth(CAR)
    label[:, 150:] = 85
    objects[mask((50, 152, 8, 8))] = 9  # nor does an object there
    region = mask(CAR, (50, 150, 10, 10))
    assert object_scores(region, label, objects, 0.5) == ObjectScores(1, 0, 0, 0)


@pytest.mark.parametrize(('left_px', 'alarms'), [(LEFT_PX - 1, 0), (LEFT_PX, 1)])
def test_leftover_at_ignored_pixels_counts_from_the_least_size_on(left_px, alarms):
    label, objects = truth()
    label[60:] = 85
    region = mask((60 - left_px, 10, left_px + 5, 1))
    assert object_scores(region, label, objects, 0.5) == ObjectScores(0, alarms, 0, alarms)


def test_small_region_that_nothing_cuts_counts():
    assert object_scores(mask((50, 50, 1, 1)), *truth(CAR), 0.5) == ObjectScores(0, 1, 1, 1)


@pytest.mark.parametrize(('apart', 'alarms'), [(TOUCH_PX - 1, 0), (TOUCH_PX, 1)])
def test_false_alarm_begins_beyond_the_surrounds_of_a_change(apart, alarms):
    for box in ((20, 20 - 4 - apart, 6, 4), (20 - 4 - apart, 20, 4, 6)):
        for there in (truth(CAR), with_rim(CAR)):
            assert object_scores(mask(box), *there, 0.25) == ObjectScores(0, 1, 1, alarms)


def test_nothing_reported_of_nothing_is_nothing():
    assert object_scores(mask(), *truth(), 0.5) == ObjectScores(0, 0, 0, 0)


# ---- registration


def test_perfect_registration_has_no_error():
    found = registration_scores(outcome(exposure_rows=40.0), case(motion=motion()))
    assert (found.epe_median, found.epe_p95, found.epe_max) == (0, 0, 0)
    assert (found.t_x_rmse, found.t_y_rmse, found.row_max, found.row_rmse) == (0, 0, 0, 0)
    assert (found.rmse, found.psnr, found.exposure_error) == (0, math.inf, 0)
    assert math.isnan(found.rmse_clean)


def test_errors_of_rows_are_their_means():
    off = places()
    off[:60] += (3.0, 4.0)
    off[60:, ::2] += (2.0, 0.0)  # cancels within the row
    off[60:, 1::2] -= (2.0, 0.0)
    found = registration_scores(
        outcome(registration=registration(places=off)), case(motion=motion())
    )
    assert found.t_x_rmse == pytest.approx(3 / math.sqrt(2))
    assert found.t_y_rmse == pytest.approx(4 / math.sqrt(2))
    assert found.row_rmse == pytest.approx(5 / math.sqrt(2))
    assert found.row_max == pytest.approx(5)
    assert found.epe_median == pytest.approx(3.5)  # half of the pixels 5 px off, half 2 px
    assert found.epe_p95 == found.epe_max == pytest.approx(5)


def test_only_unchanged_background_in_the_reference_counts():
    label, objects = truth(CAR)
    label[mask(VAN)] = 170
    label[:10] = 85
    layers = mask((50, 0, 10, 30)).astype(np.uint8)
    inside = ~mask((0, 150, 120, 10))
    elsewhere = (label != 0) | (layers > 0) | ~inside
    off, registered = places(), live_image().astype(np.float32)
    off[elsewhere] = np.nan
    registered[elsewhere] = np.nan
    found = registration_scores(
        outcome(registration=registration(places=off, registered=registered, inside=inside)),
        case(label, objects, motion=motion(layers=layers, depths=(0.8,), clean=live_image())),
    )
    assert (found.epe_max, found.row_max, found.rmse, found.rmse_clean) == (0, 0, 0, 0)


def test_light_is_compared_in_grey_levels_with_live_and_clean():
    clean = np.repeat(live_image()[..., None], 3, axis=2).astype(np.float32) + 2
    registered = live_image().astype(np.float32) + 5
    found = registration_scores(
        outcome(registration=registration(registered=registered)),
        case(motion=motion(clean=clean)),
    )
    assert found.rmse == pytest.approx(5)
    assert found.psnr == pytest.approx(20 * math.log10(255 / 5))
    assert found.rmse_clean == pytest.approx(3, rel=1e-4)  # float32 luma
    assert found.psnr_clean == pytest.approx(20 * math.log10(255 / 3), rel=1e-4)


def test_exposure_error_is_relative():
    found = registration_scores(outcome(exposure_rows=30.0), case(motion=motion()))
    assert found.exposure_error == pytest.approx(0.25)
    assert math.isnan(registration_scores(outcome(), case(motion=motion())).exposure_error)
    snap = case(motion=motion(exposure_rows=0.0))
    assert math.isnan(registration_scores(outcome(exposure_rows=3.0), snap).exposure_error)


def test_true_path_is_compared_on_judged_plain_ground():
    predicted, registered = (live_image() + np.float32(off) for off in (2, 3))
    where, valid, inside = ~mask(CAR), ~mask(VAN), ~mask((0, 150, 120, 10))
    elsewhere = ~(where & valid & inside)
    predicted[elsewhere] = registered[elsewhere] = np.nan
    found = registration_scores(
        outcome(registration=registration(registered=registered, inside=inside), valid=valid),
        case(motion=motion()),
        TruePrediction(predicted, where),
    )
    assert found.rmse_true_path == pytest.approx(2)
    assert found.times_true_path == pytest.approx(1.5)


def test_unknown_motion_leaves_only_the_light():
    found = registration_scores(outcome(exposure_rows=40.0), case())
    assert found.rmse == 0
    assert math.isnan(found.epe_median)
    assert math.isnan(found.row_rmse)
    assert math.isnan(found.exposure_error)


def test_frame_without_background_has_no_errors():
    nowhere = registration(inside=mask())
    found = registration_scores(
        outcome(registration=nowhere), case(motion=motion(clean=live_image()))
    )
    assert all(math.isnan(value) for value in vars(found).values())


# ---- all of it


def test_score_holds_everything_by_name():
    found = score(outcome(change=mask(CAR)), case(*truth(CAR), motion=motion()), 'rsmb')
    assert (found.case, found.suite, found.method) == ('planar/07', 'planar', 'rsmb')
    assert (found.changed, found.registered, found.reason, found.seconds) == (True, True, '', 0.5)
    values = found.as_dict()
    assert values['pixels']['f'] == 1.0
    assert values['objects_25'] == values['objects_50']
    assert values['objects_50'] == {'tp': 1, 'fp': 0, 'fn': 0, 'false_alarms': 0}
    assert values['registration']['epe_median'] == 0


def test_what_is_not_registered_reports_nothing():
    lost = outcome(registered=False, reason='no texture', change=~mask(), registration=None)
    found = score(lost, case(*truth(CAR), motion=motion()), 'rsmb')
    assert (found.pixels.f, found.pixels.recall, found.pixels.judged) == (0, 0, 0)
    assert found.objects_25 == ObjectScores(0, 0, 1, 0)
    assert found.reason == 'no texture'
    assert str(found.registration) == str(RegistrationScores())  # NaN is not equal to itself


def test_change_that_is_not_judged_is_no_region():
    found = score(outcome(change=mask(CAR), valid=mask()), case(*truth(CAR)), 'rsmb')
    assert found.objects_25 == ObjectScores(0, 0, 1, 0)
