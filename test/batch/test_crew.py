"""The processes: one that dies costs its recording alone."""

import os
import signal

import pytest

import rsmb_ros
from rsmb_ros.bags.mcap_scan import scan
from rsmb_ros.bags.writing import part_of
from rsmb_ros.batch.crew import LocalCrew
from rsmb_ros.batch.tasks import Task, carried_out
from rsmb_ros.replay.job import ReplayJob, replay
from rsmb_ros.replay.stored import StoredFrames


@pytest.fixture
def task_of(write_bag, tmp_path):
    """Return a function that makes a task of a bag by its number."""

    def make(n, **options):
        source, output = write_bag(tmp_path / f'{n}.mcap', n), tmp_path / f'{n}.out.mcap'
        return Task(str(n), {'source': source, 'output': output, **options}, rsmb_ros.__version__)

    return make


@pytest.mark.parametrize(('deaths', 'failed'), [(1, False), (2, True)])
def test_process_that_dies_is_replaced(deaths, failed, task_of, tmp_path):
    killed = []

    def pulse():
        pid = crew._members[0]._process.pid
        if len(killed) < deaths and pid not in killed:
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)

    with LocalCrew(1) as crew:
        first, second = crew.results([task_of(1), task_of(2)], pulse)
    assert len(killed) == deaths
    assert (first.name, second.name) == ('1', '2')
    assert second.reason == ''
    assert (tmp_path / '2.out.mcap').is_file()
    assert (first.counts is None) == failed
    if failed:
        assert first.reason.startswith('its process died 2 times, exit code -9 (-9: killed, often')


def test_process_that_dies_in_the_middle_loses_no_whole_frame(write_bag, tmp_path):
    bag, out = write_bag(tmp_path / 'a.mcap', 1, frames=60), tmp_path / 'o.mcap'
    options = {'source': bag, 'output': out, 'threads': 1}
    killed = []

    def pulse():
        part = part_of(out)
        found = scan(part) if part.exists() and not killed else None
        if found is not None and len(StoredFrames(part, found)) >= 2:
            crew._members[0]._process.kill()
            crew._members[0]._process.join()
            killed.append(len(StoredFrames(part, scan(part))))

    with LocalCrew(1) as crew:
        (outcome,) = crew.results([Task('a', options, rsmb_ros.__version__)], pulse)
    assert outcome.reason == ''
    assert 2 <= killed[0] < 60
    assert (outcome.counts.frames, outcome.counts.resumed) == (60, killed[0])
    replay(ReplayJob(bag, tmp_path / 'whole.mcap'))
    assert out.read_bytes() == (tmp_path / 'whole.mcap').read_bytes()


def test_what_is_raised_becomes_a_reason_of_one_line(task_of, monkeypatch):
    def failing(job, watch):
        raise ZeroDivisionError('of\nours')

    monkeypatch.setattr('rsmb_ros.batch.tasks.replay', failing)
    assert carried_out(task_of(1)).reason.startswith('ZeroDivisionError: of ours (')
    full = OSError(28, 'No space left on device')
    monkeypatch.setattr('rsmb_ros.batch.tasks.replay', lambda job, watch: _throw(full))
    assert carried_out(task_of(1)).reason.endswith('1.out.mcap: No space left on device')


def test_worker_of_another_version_is_refused(task_of, monkeypatch):
    task = task_of(1)
    monkeypatch.setattr('rsmb_ros.__version__', '9.9')
    assert 'the worker has rsmb_ros 9.9, the batch 0.1.0; install' in carried_out(task).reason


def test_options_that_do_not_fit_are_a_failure_of_the_recording(task_of):
    outcome = carried_out(task_of(1, workers=0))
    assert '--workers 0 must be from 1' in outcome.reason


def test_threads_are_not_written_down(task_of, tmp_path):
    written = []
    for threads in (1, 3):
        assert carried_out(task_of(1, threads=threads)).reason == ''
        written.append((tmp_path / '1.out.mcap').read_bytes())
    assert written[0] == written[1]


def _throw(error):
    raise error
