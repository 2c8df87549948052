"""`rsmb speed`: a short run measures everything, and what was measured is never lost."""

import cv2
import pytest

from rsmb_ros.cli import speed as speed_module
from rsmb_ros.evaluation.speed.machine import Rates
from rsmb_ros.evaluation.speed.probes import StartUp

SHORT = ('--sizes', '320x240', '--flights', 1, '--repeats', 1, '--stream', 2, '--rows', 1)


@pytest.fixture
def speed(rsmb):
    """Run ``rsmb speed``, as short as can be; options given later win."""

    def run(*options):
        return rsmb('speed', *SHORT, *options)

    return run


@pytest.fixture(autouse=True)
def known_machine(monkeypatch):
    """Spare the tests measuring the machine."""
    monkeypatch.setattr(speed_module, 'measured_rates', lambda threads: Rates(1e11, 1e10))


def test_short_run_measures_sizes_stream_and_rows(speed, tmp_path):
    page = tmp_path / 'SPEED.md'
    done = speed('--parts', 'sizes,stream,rows', '--markdown', page)
    assert (done.code, done.err) == (0, '')
    titles = [line.strip('*') for line in page.read_text().splitlines() if line[:2] == '**']
    assert titles[:5] == [
        'Asked for',
        'Registration and rendering',
        'End to end: changes, static objects and all',
        'Floor and memory',
        'Where the time goes at 320x240',
    ]
    assert titles[5].startswith('A stream at 640x480')
    assert titles[6:] == ['Row estimator, 3 degrees of freedom']
    assert all(title in done.out for title in titles)
    kinds = [line for line in done.out.splitlines() if line.startswith('320x240 ')]
    assert any(line.startswith('320x240 planar, exposure unknown') for line in kinds)
    assert any(line.startswith('320x240 layered, exposure given') for line in kinds)
    assert '* stream: 2 frames as `rsmb synth --frames 2` makes them' in page.read_text()


def test_parts_can_be_chosen(speed, monkeypatch):
    monkeypatch.setattr(speed_module, 'start_ups', lambda config: iter([StartUp(True, 1.0, 2.0)]))
    monkeypatch.setattr(speed_module, 'STARTS', 1)
    done = speed('--parts', 'start,rows')
    assert done.code == 0
    assert 'Row estimator' in done.out
    assert 'kernels on the disk' in done.out
    assert 'Registration and rendering' not in done.out


def test_ctrl_c_keeps_what_was_measured(speed, tmp_path, monkeypatch):
    real = speed_module.row_times

    def row_times(config, count):
        yield from real(config, 1)
        raise KeyboardInterrupt

    monkeypatch.setattr(speed_module, 'row_times', row_times)
    done = speed('--parts', 'rows', '--rows', 5, '--markdown', tmp_path / 'out.md')
    assert done.code == 130
    assert 'interrupted: 1 of 5 measurements' in done.out
    assert '| 384x256 | 1 | ' in (tmp_path / 'out.md').read_text()


ROWS = ('--set', 'registration.estimator=rows', '--set', 'registration.degrees_of_freedom=3')


@pytest.mark.parametrize(
    ('options', 'code', 'told'),
    [
        (('--parts', 'lengths'), 2, "part 'lengths' is not known: sizes, stream, rows, start"),
        (ROWS, 2, 'registration.estimator must be path'),
        (('--markdown', '/nowhere/at/all/out.md'), 1, 'cannot be written: no folder'),
        (('--sizes', '32x24'), 2, '320x240 to 7680x4320'),
    ],
)
def test_what_cannot_be_is_refused_before_the_work(speed, options, code, told, monkeypatch):
    monkeypatch.setattr(speed_module, 'warm_up', None)  # any work would fail
    done = speed(*options)
    assert done.code == code
    assert told in done.err
    assert done.out == ''


def test_opencv_gets_the_threads_of_the_detector_and_its_own_back(speed, monkeypatch):
    before, seen = cv2.getNumThreads(), []

    def row_times(config, count):
        seen.append(cv2.getNumThreads())
        yield from ()

    monkeypatch.setattr(speed_module, 'row_times', row_times)
    speed('--parts', 'rows', '--set', 'worker.threads=1')
    assert seen == [1]
    assert cv2.getNumThreads() == before
