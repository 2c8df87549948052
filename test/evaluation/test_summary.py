"""Many scores in a few numbers: what is averaged over what."""

import dataclasses
import math

import pytest

from rsmb_ros.evaluation.metrics import ObjectScores, PixelScores, RegistrationScores, Score
from rsmb_ros.evaluation.statics import StaticObject
from rsmb_ros.evaluation.summary import mean, median, percentile, summarise, worst

NAN = math.nan


def score(
    case='planar/00', method='rsmb', f=NAN, alarms=0, objects=(0, 0, 0), seconds=1.0, **given
):
    """One score; F NaN: nothing has changed."""
    tp, fp, fn = objects
    usual = {
        'changed': not math.isnan(f),
        'registered': True,
        'reason': '',
        'pixels': PixelScores(f=f, pwc=2.0),
        'objects_25': ObjectScores(tp, fp, fn, alarms),
        'objects_50': ObjectScores(0, fp + tp, fn + tp, alarms),
        'registration': RegistrationScores(),
    }
    return Score(case=case, method=method, seconds=seconds, **{**usual, **given})


def lost(case='planar/00', **given):
    return score(case, registered=False, reason='no texture', **given)


def only(scores):
    (summary,) = summarise(scores)
    return summary


def test_each_suite_and_method_has_a_summary_in_order_of_appearance():
    names = [('planar/00', 'rsmb'), ('planar/00', 'ecc'), ('real/a', 'rsmb'), ('planar/01', 'ecc')]
    found = summarise(score(case, method) for case, method in names)
    expected = [('planar', 'rsmb', 1), ('planar', 'ecc', 2), ('real', 'rsmb', 1)]
    assert [(one.suite, one.method, one.cases) for one in found] == expected


def test_f_is_over_changed_cases_and_0_where_not_registered():
    found = only([score(f=0.9), score(f=0.8), lost(f=0.0), score()])
    assert found.f_mean == pytest.approx(1.7 / 3)
    assert found.f_median == 0.8
    assert (found.changed, found.cases, found.registered) == (3, 4, 0.75)
    assert found.pwc == 2.0


def test_objects_are_counted_over_all_cases():
    found = only([score(f=1.0, objects=(3, 0, 1)), score(f=1.0, objects=(0, 2, 0)), score()])
    assert found.objects_25.recall == 3 / 4
    assert found.objects_25.precision == 3 / 5
    assert found.objects_25.f1 == pytest.approx(6 / 9)
    assert found.objects_50.recall == 0


def test_false_alarms_are_told_apart_by_what_has_changed():
    found = only([score(alarms=1), score(alarms=4), score(f=0.5, alarms=3)])
    assert found.false_alarms_unchanged == 2.5
    assert found.false_alarms_unchanged_max == 4
    assert found.false_alarms_changed == 3


def test_registration_is_over_the_cases_that_have_it():
    errors = [
        RegistrationScores(t_x_rmse=3 * n, t_y_rmse=4 * n, epe_median=n, exposure_error=0.1 * n)
        for n in range(11)
    ]
    found = only([*(score(registration=error) for error in errors), lost(), score()])
    assert (found.t_x_rmse, found.t_y_rmse) == (15, 20)
    assert (found.row_median, found.row_p90) == pytest.approx((25, 45))
    assert (found.epe_median, found.epe_p90) == pytest.approx((5, 9))
    assert found.exposure_error == pytest.approx(0.5)
    assert math.isnan(found.rmse_clean)


def test_depth_error_is_that_of_all_static_objects_found():
    objects = [StaticObject(0.8, found, 5.0, 3.0, 8.0, False) for found in (0.9, 1.0, 0.4, NAN)]
    found = only([score(), score(statics=objects[:2]), score(statics=objects[2:])])
    assert found.depth_error == pytest.approx(0.2)


def test_misfit_beside_the_true_path_is_over_cases():
    errors = [RegistrationScores(times_true_path=1 + 0.1 * n) for n in range(11)]
    found = only([*(score(registration=error) for error in errors), lost(), score()])
    assert found.times_true_path == pytest.approx(1.5)
    assert found.times_true_path_p90 == pytest.approx(1.9)


def test_equal_images_have_an_infinite_psnr():
    errors = [RegistrationScores(rmse=0.0, psnr=math.inf)] * 2
    assert only([score(registration=error) for error in errors]).psnr == math.inf


def test_time_is_compared_with_ecc_on_the_same_suite():
    ours = [score(f'planar/{n}', seconds=float(n)) for n in range(1, 6)]
    ecc = [score('planar/1', 'ecc', seconds=0.5), score('real/1', 'ecc', seconds=9.0)]
    found = summarise([*ours, *ecc, score('other/1')])
    assert (found[0].seconds_q1, found[0].seconds, found[0].seconds_q3) == (2, 3, 4)
    assert [one.times_ecc for one in found[:3]] == [6, 1, 1]
    assert math.isnan(found[3].times_ecc)


def test_what_no_case_knows_is_nan():
    found = only([lost()])
    assert found.registered == 0
    unknown = (found.f_mean, found.epe_p90, found.objects_25.f1, found.false_alarms_changed)
    assert all(map(math.isnan, unknown))
    assert found.as_dict().keys() == {field.name for field in dataclasses.fields(found)}


def test_averages_pass_over_nan():
    assert mean([1.0, NAN, 3.0]) == 2
    assert median([NAN, 5.0]) == 5
    assert percentile([NAN, 0.0, 10.0], 90) == 9
    assert all(math.isnan(of([NAN])) for of in (mean, median, lambda v: percentile(v, 50)))


def test_worst_are_those_not_registered_then_by_what_is_lost():
    scores = [
        score('a/good', f=0.95),
        score('a/perfect', f=1.0),
        score('a/quiet'),
        score('a/noisy', alarms=9),
        score('a/bad', f=0.3),
        lost('a/lost'),
        lost('a/lost_changed', f=0.0),
    ]
    names = ['a/lost_changed', 'a/lost', 'a/noisy', 'a/bad', 'a/good']
    assert [one.case for one in worst(scores)] == names
    assert [one.case for one in worst(scores, 2)] == names[:2]
    assert [one.case for one in worst(reversed(scores), 9)] == names
