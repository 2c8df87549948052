"""Differences are taken case by case; what they are worth can be worked out by hand."""

import math

import pytest

from rsmb_ros.evaluation.ablation.measure import ALL_ON, ALONE, PERSISTENT, Measured
from rsmb_ros.evaluation.ablation.results import AblationResults
from rsmb_ros.evaluation.metrics import ObjectScores, PixelScores, RegistrationScores, Score

NAN = math.nan


def scored(case, f=NAN, alarms=0, seconds=0.1):
    """Return a score; `f` NaN: nothing has changed in the case."""
    objects = ObjectScores(1, alarms, 0, alarms)
    return Score(
        case=case,
        method='',
        changed=not math.isnan(f),
        registered=True,
        reason='',
        seconds=seconds,
        pixels=PixelScores(f=f, judged=0.9),
        objects_25=objects,
        objects_50=objects,
        registration=RegistrationScores(),
    )


@pytest.fixture
def results():
    """Return results of three cases of two suites with layers on and off."""
    found = AblationResults({'suites': 'a b'})
    pairs = (
        (scored('a/0', 0.9), scored('a/0', 0.5, 2, 0.05)),
        (scored('a/1', 0.8), scored('a/1', 0.805, 0, 0.2)),
        (scored('b/0', alarms=1), scored('b/0')),
    )
    for full, off in pairs:
        found.add(Measured({ALL_ON: full, 'layers': off}))
    return found


def cells(table, row):
    """Return a row by its headings; of equal ones the last."""
    return dict(zip(table.head, table.rows[row], strict=True))


def test_all_suites_then_each(results):
    titles = [table.title for table in results.tables()]
    assert titles == ['all suites, 2 of 3 changed', 'a, 2 of 2 changed', 'b, 0 of 1 changed']


def test_difference_is_the_mean_over_cases(results):
    full, off = (results.tables()[0].rows[n] for n in range(2))
    assert full[:3] == [ALL_ON, '0.850', '-']
    assert off[:3] == ['layers', '0.653', '-0.198']  # -0.4 and +0.005; F 0.6525
    assert off[4:7] == ['0.67', '+0.33', '1, 1']  # alarms 2, 0, 0 for 0, 0, 1
    assert full[6] == '-'


def test_time_is_compared_case_by_case(results):
    """0.05, 0.2 and 0.1 s for 0.1 s each."""
    off = results.tables()[0].rows[1]
    assert off[-4:] == ['100', '75 - 150', '1.00', '0.75 - 1.50']


def test_suite_without_a_change_has_no_f(results):
    row = cells(results.tables()[2], 1)
    assert row['F mean'] == '-'
    assert row['false alarms'] == '0.00'
    assert row['worse, better'] == '0, 1'


def test_streams_are_compared_with_persistence(results):
    results.add(Measured({PERSISTENT: scored('s/0', 0.0), ALONE: scored('s/0', 1.0, 1)}))
    table = results.tables()[-1]
    assert table.title == 's, 1 of 1 changed'
    assert [row[0] for row in table.rows] == [PERSISTENT, ALONE]
    assert table.rows[1][2] == '+1.000'


def test_one_suite_is_not_said_twice():
    found = AblationResults({})
    found.add(Measured({ALL_ON: scored('a/0', 0.9), 'layers': scored('a/0', 0.5)}))
    assert [table.title for table in found.tables()] == ['a, 1 of 1 changed']


def test_nothing_measured_gives_no_tables():
    assert AblationResults({}).tables() == []


def test_page_says_what_happens_without(results):
    page = results.as_markdown()
    assert page.startswith('# Ablation\n')
    assert '\n* suites: a b\n' in page
    assert '\n* **layers** (objects and layers): the scene counts as flat\n' in page
    assert f'\n* **persistence**: {ALONE}\n' in page
    assert page.count('\n**') == 3
