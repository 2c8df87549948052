"""Tables say what was measured, and '-' where nothing was."""

import json
import math

import pytest

from rsmb_ros.evaluation.metrics import ObjectScores, PixelScores, RegistrationScores, Score
from rsmb_ros.evaluation.published import PUBLISHED, Published
from rsmb_ros.evaluation.suites.simulated import AUTHORS
from rsmb_ros.evaluation.summary import Summary, summarise
from rsmb_ros.evaluation.tables import markdown, plain, suite_table, to_json


def score(method, **given):
    usual = {
        'case': 'authors/00',
        'changed': True,
        'registered': True,
        'reason': '',
        'seconds': 0.25,
        'pixels': PixelScores(f=0.9, precision=0.8, pwc=1.5),
        'objects_25': ObjectScores(3, 1, 0, 2),
        'objects_50': ObjectScores(0, 4, 3, 2),
        'registration': RegistrationScores(t_x_rmse=0.125, t_y_rmse=0.5, psnr=math.inf),
    }
    return Score(method=method, **{**usual, **given})


@pytest.fixture
def scores():
    other = score('rsmb', case='planar/00', pixels=PixelScores(f=0.1))
    nothing = RegistrationScores()
    return [score('ecc', seconds=0.05, registration=nothing), score('rsmb'), other]


@pytest.fixture
def table(scores):
    return suite_table('authors', summarise(scores), PUBLISHED['authors/planar RSMB'])


def cells(table, method):
    return next(dict(zip(table.head, row, strict=True)) for row in table.rows if row[0] == method)


def test_ours_comes_first_and_the_published_last(table):
    methods = [row[0] for row in table.rows]
    assert methods == [
        'rsmb',
        'ecc',
        'TPAMI',
        *(one.method for one in PUBLISHED['authors/planar RSMB'][1:]),
    ]
    assert table.title == 'authors, 1 of 1 cases changed'


def test_accuracy_and_time_stand_side_by_side(table):
    assert cells(table, 'rsmb') == {
        'method': 'rsmb',
        'F mean / median': '0.900 / 0.900',
        'PWC %': '1.50',
        'precision': '0.800',
        'objects recall / precision': '1.00 / 0.75',
        'false alarms unchanged / changed': '- / 2.00',
        'registered %': '100',
        'rows t_x / t_y px': '0.12 / 0.50',
        'EPE median / p90 px': '-',
        'RMSE': '-',
        'x true path median / p90': '-',
        'PSNR dB': 'inf',
        's per frame': '0.250',
        'quartiles': '0.250 / 0.250',
        'x ECC': '5.00',
    }


def test_what_is_not_known_is_a_dash(table):
    assert cells(table, 'ecc')['rows t_x / t_y px'] == '-'
    assert cells(table, 'ecc')['PSNR dB'] == '-'


def test_published_rows_hold_what_the_authors_print():
    rows = (Published('theirs', {'f_mean': (0.56, 0.75), 't_x_rmse': 0.18, 't_y_rmse': 0.14}),)
    found = cells(suite_table('authors', [], rows), 'theirs')
    assert found['F mean / median'] == '0.560-0.750 / -'
    assert found['rows t_x / t_y px'] == '0.18 / 0.14'
    assert {found[name] for name in ('PWC %', 's per frame', 'x ECC')} == {'-'}


def test_published_figures_are_named_like_ours():
    known = Summary.__dataclass_fields__
    for suite, rows in PUBLISHED.items():
        for row in rows:
            assert set(row.values) <= set(known), (suite, row.method)


def test_published_rows_stand_below_suites_that_exist():
    groups = {f'authors/{name}' for name in AUTHORS}
    assert set(PUBLISHED) <= groups


def test_columns_of_plain_text_are_aligned(table):
    title, *lines = plain(table).splitlines()
    assert title == table.title
    rule = next(n for n, line in enumerate(lines) if set(line) == {'-'})
    heads, rows = lines[:rule], lines[rule + 1 :]
    assert len(rows) == len(table.rows)
    assert {len(line) for line in rows} == {len(lines[rule])}
    assert max(map(len, heads)) <= len(lines[rule])
    end = rows[0].index('1.50') + len('1.50')  # PWC ends where all PWC end
    assert rows[2][end - 4 : end] == '0.67'


def test_markdown_has_as_many_cells_everywhere(table):
    title, empty, *lines = markdown(table).splitlines()
    assert (title, empty) == ('**authors, 1 of 1 cases changed**', '')
    assert {line.count('|') for line in lines} == {len(table.head) + 1}
    assert lines[0].startswith('| method | F mean / median |')
    assert lines[2].startswith('| rsmb | 0.900 / 0.900 |')


def test_json_holds_everything_and_null_for_what_is_not_finite(scores):
    content = json.loads(to_json(scores, {'machine': 'two cores', 'load': math.nan}))
    assert content['about'] == {'machine': 'two cores', 'load': None}
    assert [one['method'] for one in content['summaries']] == ['ecc', 'rsmb', 'rsmb']
    ours = content['cases'][1]
    assert ours['pixels'] == {
        **dict.fromkeys(vars(PixelScores())),
        'f': 0.9,
        'precision': 0.8,
        'pwc': 1.5,
    }
    assert ours['registration']['t_x_rmse'] == 0.125
    assert ours['registration']['psnr'] is None
    assert ours['statics'] == []
    assert content['summaries'][1]['objects_25']['recall'] == 1.0
