"""`rsmb evaluate`: tables of suites and folders, and what was measured is never lost."""

import json
import math

import cv2
import numpy as np
import pytest

from rsmb_ros.cli import evaluate as evaluate_module
from rsmb_ros.cli.main import main
from rsmb_ros.evaluation.run import KNOWN_METHODS
from rsmb_ros.evaluation.suites import SUITES

FAST = ('--methods', 'ecc,orb')


@pytest.fixture(scope='session')
def flown(tmp_path_factory):
    """Return a folder with two frames, as ``rsmb synth`` writes it."""
    folder = tmp_path_factory.mktemp('data') / 'flown'
    options = ['--size', '320x240', '--blur', '3', '--frames', '2', '--offset', '5']
    assert main(['synth', '-o', str(folder), *options]) == 0
    return folder


@pytest.fixture
def evaluate(rsmb):
    """Run ``rsmb evaluate`` with two fast rivals; options given later win."""

    def run(*options):
        return rsmb('evaluate', *FAST, *options)

    return run


@pytest.fixture
def interrupted_at(monkeypatch):
    """Return a function after which Ctrl-C falls into the n-th case, n from 1."""

    def at(number):
        real, calls = evaluate_module.run_case, []

        def run_case(case, methods):
            calls.append(case.name)
            if len(calls) == number:
                raise KeyboardInterrupt
            return real(case, methods)

        monkeypatch.setattr(evaluate_module, 'run_case', run_case)

    return at


def rows_of(text, method):
    """Lines of the tables that belong to a method."""
    return [line for line in text.splitlines() if line.split()[:1] == [method]]


def strict(text):
    """Parse JSON that holds no NaN and no infinity."""

    def refuse(name):
        raise AssertionError(f'{name} is no JSON')

    return json.loads(text, parse_constant=refuse)


# -- what is measured ----------------------------------------------------------------------------


def test_suite_gives_a_table(evaluate):
    done = evaluate('quick', '--first', 1)
    assert (done.code, done.err) == (0, '')
    assert done.out.startswith('quick, 1 of 1 cases changed\n')
    assert [len(rows_of(done.out, method)) for method in ('ecc', 'orb', 'rsmb')] == [1, 1, 0]


def test_folder_of_synth_gives_a_table(evaluate, flown):
    done = evaluate(flown)
    assert (done.code, done.err) == (0, '')
    assert done.out.startswith('flown, 1 of 2 cases changed\n')
    assert len(rows_of(done.out, 'ecc')) == 1


def test_each_suite_and_folder_has_its_table(evaluate, flown):
    done = evaluate('quick', flown, '--first', 1)
    assert done.code == 0
    assert len(rows_of(done.out, 'orb')) == 2
    assert done.out.index('quick, 1 of 1') < done.out.index('flown, 0 of 1')


def test_ours_uses_the_configuration(evaluate, flown):
    """No change is as large as a tenth of the frame."""
    done = evaluate(flown, '--methods', 'rsmb', '--set', 'change.min_area=0.1')
    assert done.code == 0
    assert 'Worst of rsmb in flown: flown/001 (F 0.00, 0 of 2 objects, ' in done.out


def test_a_method_named_twice_is_measured_once(evaluate, flown):
    done = evaluate(flown, '--first', 1, '--methods', 'ecc,ecc')
    assert (done.code, len(rows_of(done.out, 'ecc'))) == (0, 1)


def test_folder_without_truth_json_is_measured_too(evaluate, flown, tmp_path):
    for name in ('reference', 'live_001', 'truth_001'):
        (tmp_path / f'{name}.png').write_bytes((flown / f'{name}.png').read_bytes())
    done = evaluate(tmp_path)
    assert done.code == 0
    assert done.out.startswith(f'{tmp_path.name}, 1 of 1 cases changed\n')


# -- what is written -----------------------------------------------------------------------------


def test_report_is_a_page_and_json_beside_it(evaluate, flown, tmp_path):
    done = evaluate(flown, '--report', tmp_path / 'out.html')
    assert done.code == 0
    assert {path.name for path in tmp_path.iterdir()} == {'out.html', 'out.json'}
    page = (tmp_path / 'out.html').read_text()
    assert '</html>' in page
    assert 'flown, 1 of 2 cases changed' in page
    assert page.count('contact sheet, flown/') >= 1  # of a worst case
    content = strict((tmp_path / 'out.json').read_text())
    assert [(case['case'], case['method']) for case in content['cases']] == [
        (f'flown/{number}', method) for number in ('000', '001') for method in ('ecc', 'orb')
    ]
    assert [one['method'] for one in content['summaries']] == ['ecc', 'orb']
    assert content['about']['suites'] == str(flown)
    assert set(content['about']['methods']) == {'ecc', 'orb'}


def test_json_holds_the_numbers_of_the_table(evaluate, flown, tmp_path):
    done = evaluate(flown, '--report', tmp_path / 'out.html')
    summary, _ = strict((tmp_path / 'out.json').read_text())['summaries']
    (row,) = rows_of(done.out, 'ecc')
    assert row.split()[1:5] == [
        f'{summary["f_mean"]:.3f}',
        '/',
        f'{summary["f_median"]:.3f}',
        f'{summary["pwc"]:.2f}',
    ]
    assert math.isfinite(summary['epe_median'])


def test_markdown_says_methods_suites_and_results(evaluate, flown, tmp_path):
    assert evaluate('quick', flown, '--first', 1, '--markdown', tmp_path / 'out.md').code == 0
    text = (tmp_path / 'out.md').read_text()
    assert '* `ecc`: OpenCV findTransformECC' in text
    assert f'* **quick**: {"; ".join(SUITES["quick"].frequencies)}\n' in text
    assert '* **flown**: as it is\n' in text
    assert '\n## quick\n' in text
    assert '\n## flown\n' in text
    assert text.count('\n| ecc |') == 2


def test_sheets_are_pictures_of_the_worst_cases(evaluate, flown, tmp_path):
    assert evaluate(flown, '--sheets', tmp_path / 'deep' / 'sheets').code == 0
    (path,) = (tmp_path / 'deep' / 'sheets').glob('flown_001.png')  # a blurred change
    assert cv2.imread(str(path)).ndim == 3


# -- Ctrl-C --------------------------------------------------------------------------------------


def test_ctrl_c_keeps_what_was_measured(evaluate, flown, tmp_path, interrupted_at):
    interrupted_at(2)
    outputs = ('--report', tmp_path / 'out.html', '--markdown', tmp_path / 'out.md')
    done = evaluate(flown, *outputs, '--sheets', tmp_path / 'sheets')
    assert done.code == 130
    assert 'flown, 0 of 1 cases changed' in done.out
    assert 'interrupted: 1 of 2 cases' in done.out
    assert done.err == 'rsmb: error: interrupted; what was finished is kept\n'
    found = strict((tmp_path / 'out.json').read_text())['cases']
    assert [one['case'] for one in found] == ['flown/000'] * 2
    assert (tmp_path / 'out.md').exists()


def test_ctrl_c_before_the_first_case_writes_nothing(evaluate, flown, tmp_path, interrupted_at):
    interrupted_at(1)
    done = evaluate(flown, '--report', tmp_path / 'out.html')
    assert (done.code, done.out) == (130, 'interrupted: 0 of 2 cases\n')
    assert list(tmp_path.iterdir()) == []


# -- bad usage and bad data ----------------------------------------------------------------------


@pytest.fixture
def refused(evaluate, tmp_path):
    """Run what must be refused before anything is written; returns exit code and message."""

    def run(*options):
        out = tmp_path / 'written'
        out.mkdir()
        outputs = ('--report', out / 'a.html', '--markdown', out / 'a.md', '--sheets', out / 's')
        done = evaluate(*outputs, *options)
        assert (done.out, list(out.iterdir())) == ('', [])
        return done.code, done.err

    return run


def test_unknown_suite_lists_the_known(refused, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    suites = ', '.join(SUITES)
    told = f"rsmb: error: 'slow' is neither a suite nor a folder; suites: {suites}\n"
    assert refused('quick', 'slow') == (2, told)


def test_unknown_method_lists_the_known(refused):
    told = f"rsmb: error: method 'surf' is not known: {', '.join(KNOWN_METHODS)}\n"
    assert refused('quick', '--methods', 'ecc,surf') == (2, told)


@pytest.mark.parametrize('suite', ['photos', 'video'])
def test_suite_of_real_pictures_says_how_to_give_them(refused, suite, monkeypatch):
    monkeypatch.delenv('RSMB_DATA', raising=False)
    code, told = refused('quick', suite)
    assert code == 1
    assert f'suite {suite} needs ' in told
    assert 'give the folder that holds them with --data or RSMB_DATA' in told


@pytest.mark.parametrize('as_option', [True, False])
def test_data_folder_without_the_pictures_is_named(refused, tmp_path, monkeypatch, as_option):
    monkeypatch.setenv('RSMB_DATA', str(tmp_path / 'other' if as_option else tmp_path))
    code, told = refused('video', *(('--data', tmp_path) if as_option else ()))
    assert code == 1
    assert told.startswith(f'rsmb: error: {tmp_path}: suite video needs ')
    assert 'missing there: video/' in told


def test_report_must_be_html(refused, tmp_path):
    path = tmp_path / 'written' / 'a.pdf'
    told = f'rsmb: error: --report {path}: must end in .html\n'
    assert refused('quick', '--report', path) == (2, told)


@pytest.mark.parametrize('option', ['--report', '--markdown'])
def test_output_in_a_missing_folder_is_refused_before_the_work(refused, tmp_path, option):
    path = tmp_path / 'gone' / 'a.html'
    told = f'rsmb: error: {path}: cannot be written: no folder {tmp_path / "gone"}\n'
    assert refused('quick', option, path) == (1, told)


def test_folder_without_truth_is_refused(refused, flown, tmp_path):
    (tmp_path / 'mine').mkdir()
    for name in ('reference', 'live_000'):
        (tmp_path / 'mine' / f'{name}.png').write_bytes((flown / f'{name}.png').read_bytes())
    code, told = refused('quick', tmp_path / 'mine')
    assert code == 1
    assert told.endswith('live_000.png: has no truth, truth_000.png is missing\n')


def test_folder_without_images_says_how_to_make_one(refused, tmp_path):
    code, told = refused(tmp_path)
    assert code == 1
    assert f'{tmp_path}: holds no reference.png' in told
    assert '`rsmb synth -o ' in told


def test_file_is_no_folder(refused, flown):
    code, told = refused(flown / 'truth.json')
    assert (code, 'truth.json: no such folder and no suite' in told) == (1, True)


def test_bad_frame_is_refused_before_the_work(refused, flown, tmp_path):
    for path in flown.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    cv2.imwrite(str(tmp_path / 'truth_001.png'), np.full((240, 320), 3, np.uint8))
    code, told = refused('quick', tmp_path)
    assert code == 1
    assert 'truth_001.png: holds labels [3], must be of (0, 85, 170, 255)' in told


def test_targets_of_one_name_are_refused(refused, flown, tmp_path):
    code, told = refused(flown, f'{flown}/.')
    assert code == 2
    assert told == f'rsmb: error: two of {flown}, {flown}/. have the same name\n'


def test_wrong_setting_is_refused(refused, flown):
    code, told = refused(flown, '--set', 'change.area=1')
    assert code == 2
    assert 'change.area' in told
