"""Results keep every number, the pictures of the worst cases only, and read well everywhere."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import rsmb_ros
from rsmb_ros.evaluation.case import Case
from rsmb_ros.evaluation.environment import environment
from rsmb_ros.evaluation.methods import Outcome, Registration
from rsmb_ros.evaluation.metrics import ObjectScores, PixelScores, RegistrationScores, Score
from rsmb_ros.evaluation.results import WORST, Results, outcome_line
from rsmb_ros.evaluation.run import CaseRun
from rsmb_ros.evaluation.static_table import STATIC_NOTES
from rsmb_ros.evaluation.statics import StaticObject
from rsmb_ros.evaluation.tables import NOTES

ROWS, COLS = 48, 64
SOURCES = {'rsmb': 'this project', 'ecc': 'OpenCV'}


def score(case, method='rsmb', f=math.nan, alarms=0, registered=True):
    """One score; F NaN: nothing has changed."""
    return Score(
        case=case,
        method=method,
        changed=not math.isnan(f),
        registered=registered,
        reason='' if registered else 'no texture',
        seconds=0.25,
        pixels=PixelScores(f=f, pwc=2.0),
        objects_25=ObjectScores(1, 0, 1, alarms),
        objects_50=ObjectScores(0, 1, 2, alarms),
        registration=RegistrationScores(psnr=math.inf),
    )


def ran(case, registered=True, **given):
    """One case on which ecc is perfect and ours as given."""
    image = np.full((ROWS, COLS), 100, np.uint8)
    nothing, all_of_it = np.zeros((ROWS, COLS), bool), np.ones((ROWS, COLS), bool)
    y, x = np.mgrid[:ROWS, :COLS].astype(np.float32)
    found = Registration(image.astype(np.float32), all_of_it, np.dstack([x, y]))
    outcome = Outcome(registered, '', nothing, all_of_it, found if registered else None, 0.25)
    scores = {'rsmb': score(case, registered=registered, **given)}
    scores['ecc'] = score(case, 'ecc', f=1.0)
    label = np.zeros((ROWS, COLS), np.uint8)
    return CaseRun(Case(case, image, image, label, label), dict.fromkeys(scores, outcome), scores)


@pytest.fixture
def results():
    """Return nothing measured yet."""
    return Results('rsmb', SOURCES, {'suites': 'planar nochange'})


@pytest.fixture
def filled(results):
    """Return two cases of one suite and one of another."""
    for run in (
        ran('planar/00', f=0.5, alarms=3),
        ran('planar/01', f=0.0, registered=False),
        ran('nochange/00'),
    ):
        results.add(run)
    return results


# -- what is kept --------------------------------------------------------------------------------


@pytest.mark.parametrize('order', ['best first', 'worst first'])
def test_only_the_worst_sheets_of_each_suite_are_kept(results, order):
    numbers = list(range(WORST + 3))
    for n in numbers if order == 'worst first' else reversed(numbers):
        for suite in ('planar', 'light'):
            results.add(ran(f'{suite}/{n:02d}', f=0.1 * n))
    for suite in ('planar', 'light'):
        names = [f'{suite}/{n:02d}' for n in range(WORST)]
        assert [one.case for one in results.worst(suite)] == names
    sheets = results.sheets()
    assert len(sheets) == 2 * WORST
    assert len(results._sheets) == 2 * WORST  # pictures are large
    assert all(sheet.ndim == 3 and sheet.dtype == np.uint8 for _, sheet in sheets)
    assert len(results.scores) == 2 * 2 * len(numbers)


def test_perfect_cases_have_no_sheet(results):
    results.add(ran('planar/00', f=1.0))
    results.add(ran('nochange/00'))
    assert results.sheets() == []
    assert 'Worst' not in results.as_text()


def test_a_case_not_registered_has_a_sheet_too(results):
    results.add(ran('planar/00', f=0.0, registered=False))
    ((found, sheet),) = results.sheets()
    assert (found.case, sheet.ndim) == ('planar/00', 3)


def test_worst_are_those_of_the_shown_method_alone():
    results = Results('ecc', SOURCES, {})
    results.add(ran('planar/00', f=0.0))
    assert results.sheets() == []


def test_groups_of_a_suite_are_suites(results):
    for case in ('authors/3D RS/07', 'authors/planar RS/05', 'authors/3D RS/15'):
        results.add(ran(case, f=0.5))
    assert results.suites == ['authors/3D RS', 'authors/planar RS']
    assert [len(results.worst(suite)) for suite in results.suites] == [2, 1]


# -- how it reads --------------------------------------------------------------------------------


def test_text_has_a_table_a_suite_and_names_the_worst(filled):
    text = filled.as_text()
    assert text.startswith('planar, 2 of 2 cases changed\n')
    assert '\nnochange, 0 of 1 cases changed\n' in text
    assert (
        'Worst of rsmb in planar: planar/01 (not registered: no texture); '
        'planar/00 (F 0.50, 1 of 2 objects, 3 false alarms)\n'
    ) in text
    assert 'in nochange' not in text
    assert text.endswith(NOTES)


def test_markdown_says_how_it_was_measured(filled):
    lines = filled.as_markdown({'planar': ('noise in 30%', 'JPEG'), 'mine': ()}).splitlines()
    assert lines[0] == '# Results'
    assert '* suites: planar nochange' in lines
    assert f'* machine: {environment()["machine"]}' in lines
    assert '* `ecc`: OpenCV' in lines
    assert '* **planar**: noise in 30%; JPEG' in lines
    assert '* **mine**: as it is' in lines
    assert [line for line in lines if line.startswith('## ')] == [
        '## Methods',
        '## Suites',
        '## planar',
        '## nochange',
    ]
    assert sum(line.startswith('| rsmb |') for line in lines) == 2
    assert sum(line.startswith('* Worst of rsmb in planar: ') for line in lines) == 1


def test_json_holds_every_score_and_no_nan(filled):
    def refuse(name):
        raise AssertionError(f'{name} is no JSON')

    content = json.loads(filled.as_json(), parse_constant=refuse)
    assert len(content['cases']) == 6
    assert content['cases'][0]['pixels']['f'] == 0.5
    assert content['cases'][0]['registration']['psnr'] is None  # infinite
    assert content['about']['methods'] == SOURCES
    assert content['about']['rsmb_ros'] == rsmb_ros.__version__
    keys = [(one['suite'], one['method']) for one in content['summaries']]
    assert keys == [(s, m) for s in ('planar', 'nochange') for m in ('rsmb', 'ecc')]


def test_summary_is_text_for_the_top_of_a_page(filled):
    summary = filled.summary()
    assert summary['suites'] == 'planar nochange'
    assert {'machine', 'date', 'Python', 'numpy'} <= summary.keys()
    assert all(isinstance(value, str) for value in summary.values())


@pytest.mark.parametrize(
    ('given', 'line'),
    [
        ({'registered': False, 'f': 0.0}, 'not registered: no texture'),
        ({'alarms': 2}, '2 false alarms'),
        ({'f': 0.834, 'alarms': 0}, 'F 0.83, 1 of 2 objects, 0 false alarms'),
    ],
)
def test_one_line_says_how_a_case_went(given, line):
    assert outcome_line(score('planar/00', **given)) == line


def test_environment_names_machine_and_versions():
    found = environment()
    assert ' cores, ' in found['machine']
    assert found['numpy'] == np.__version__
    assert all(found.values())


def test_library_installed_by_another_name_is_no_error(monkeypatch):
    """Of apt, OpenCV has no wheel's name."""
    monkeypatch.setattr('rsmb_ros.evaluation.environment._LIBRARIES', ('no-such-wheel',))
    assert environment()['no-such-wheel'] == 'installed otherwise'


def test_static_objects_have_a_table_of_their_own(results):
    one = ran('layered/00', f=0.5)
    known = StaticObject(0.8, 0.81, 6.0, 5.0, 8.0, False)
    results.add(
        replace(one, scores={n: replace(s, statics=(known,)) for n, s in one.scores.items()})
    )
    assert 'static objects, rsmb\n' in results.as_text()
    assert results.as_text().endswith(STATIC_NOTES)
    lines = results.as_markdown({}).splitlines()
    assert lines.index('## Static objects') > lines.index('## layered')
    assert '| layered | all | 1 | 100 | 0.010 / 0.010 | 100 | 0 of 1 |' in lines
