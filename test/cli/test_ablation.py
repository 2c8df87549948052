"""`rsmb ablation`: a table of what each part is worth, never lost."""

import pytest

from rsmb_ros.cli import ablation as ablation_module

SHORT = ('quick:2', '--only', 'layers,saturation', '--stream', 0)


@pytest.fixture
def ablation(rsmb):
    """Run ``rsmb ablation`` on two small cases; options given later win."""

    def run(*options):
        return rsmb('ablation', *SHORT, *options)

    return run


def rows_of(text):
    """First cells of the rows of a markdown page's last table."""
    lines = [line for line in text.split('\n**')[-1].splitlines() if line.startswith('| ')]
    return [line.split('|')[1].strip() for line in lines[2:]]


def test_each_part_has_a_row(ablation, tmp_path):
    done = ablation('--markdown', tmp_path / 'out.md')
    assert (done.code, done.err) == (0, '')
    assert done.out.startswith('quick, 2 of 2 changed\n')
    assert rows_of((tmp_path / 'out.md').read_text()) == ['everything on', 'layers', 'saturation']


def test_streams_are_flown_with_persistence_and_without(rsmb, tmp_path, monkeypatch):
    monkeypatch.setattr('rsmb_ros.evaluation.ablation.measure.SHAPE', (240, 320))
    page = tmp_path / 'out.md'
    done = rsmb('ablation', 'quick:1', '--only', 'layers', '--stream', 2, '--markdown', page)
    assert done.code == 0
    assert '**a stream, 2 objects appear, ' in page.read_text()
    assert '**a stream, nothing changes, 0 of 2 changed**' in page.read_text()
    assert rows_of(page.read_text()) == ['persistence 3 of 5', 'each frame alone']


def test_ctrl_c_keeps_what_was_measured(ablation, tmp_path, monkeypatch):
    real, calls = ablation_module.ablated, []

    def ablated(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(ablation_module, 'ablated', ablated)
    done = ablation('--markdown', tmp_path / 'out.md')
    assert done.code == 130
    assert 'interrupted: 1 of 2 cases' in done.out
    assert len(rows_of((tmp_path / 'out.md').read_text())) == 3


@pytest.mark.parametrize(
    ('options', 'code', 'told'),
    [
        (('plannar',), 2, "'plannar' is not a suite; suites: quick, planar"),
        (('quick:7',), 2, "'quick:7': '7' cases, must be 1 to 6"),
        (('quick:some',), 2, "'quick:some': 'some' cases, must be 1 to 6"),
        (('quick', '--only', 'roofs'), 2, "'roofs' cannot be switched off: known are noise by"),
        (('quick', '--markdown', '/nowhere/at/all/out.md'), 1, 'cannot be written: no folder'),
        (
            ('quick', '--set', 'change.threshold_high=4.0'),
            2,
            'change.threshold_low = 4.99 must be below',
        ),
    ],
)
def test_what_cannot_be_is_refused_before_the_work(rsmb, options, code, told, monkeypatch):
    monkeypatch.setattr(ablation_module, 'warm_up', lambda config: None)
    monkeypatch.setattr(ablation_module, 'ablated', None)  # any work would fail
    done = rsmb('ablation', *options)
    assert done.code == code
    assert told in done.err
    assert done.out == ''
