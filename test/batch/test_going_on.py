"""The same command again goes on; what is there and was made otherwise is told."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from rsmb_ros.bags.mcap_scan import scan
from rsmb_ros.batch.batch import Batch, BatchJob
from rsmb_ros.batch.items import Item
from rsmb_ros.batch.manifest import PENDING
from rsmb_ros.replay.job import ReplayJob, replay
from rsmb_ros.replay.stored import StoredFrames

DEADLINE_S = 120.0  # a loaded machine starts Python slowly
FRAMES = 40  # more than are done while one looks away


def entries_of(folder):
    content = json.loads((folder / 'manifest.json').read_text())
    return {entry['name']: entry for entry in content['bags']}


def times_of(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob('*.mcap')}


@pytest.mark.usefixtures('one_process')
def test_done_ones_are_left_and_failed_ones_tried_again(rsmb, write_bag, tmp_path):
    bags = [write_bag(tmp_path / f'{n}.mcap', n) for n in range(2)]
    whole = bags[1].read_bytes()
    bags[1].write_bytes(b'')
    out = tmp_path / 'out'
    assert rsmb('batch', *bags, '-o', out)[0] == 1
    first = times_of(out)
    bags[1].write_bytes(whole)
    code, lines, err = rsmb('batch', *bags, '-o', out)
    assert (code, err) == (0, [])
    assert '2 recordings: 1 done, 1 done before, 0 failed; 2 frames' in lines[-1]
    second = times_of(out)
    assert second['0.mcap'] == first['0.mcap']
    code, lines, _ = rsmb('batch', *bags, '-o', out)
    assert (code, lines) == (0, [f'2 recordings: 0 done, 2 done before, 0 failed -> {out}'])
    assert times_of(out) == second


@pytest.mark.usefixtures('one_process')
def test_what_was_done_otherwise_is_left_until_again(rsmb, write_bag, tmp_path):
    bag, out = write_bag(tmp_path / 'a.mcap', 1), tmp_path / 'out'
    assert rsmb('batch', bag, '-o', out, '--max-frames', 1)[0] == 0
    before = (out / 'a.mcap').read_bytes()
    higher = ['--set', 'change.threshold_high=7']
    code, lines, err = rsmb('batch', bag, '-o', out, *higher)
    assert code == 1
    assert err == [
        'rsmb: error: a: left as it was done: change.threshold_high was 5.0, is 7.0; '
        'max_frames was 1, is not given; --again replays it'
    ]
    assert '1 left as they were' in lines[-1]
    assert (out / 'a.mcap').read_bytes() == before
    assert entries_of(out)['a']['wish']['settings'] == {'max_frames': 1}
    assert rsmb('batch', bag, '-o', out, *higher, '--again')[0] == 0
    assert entries_of(out)['a']['wish']['settings'] == {'change.threshold_high': 7.0}
    assert (out / 'a.mcap').read_bytes() != before


@pytest.mark.usefixtures('one_process')
def test_changed_input_and_other_version_are_told(rsmb, write_bag, tmp_path, monkeypatch):
    bag, out = write_bag(tmp_path / 'a.mcap', 1), tmp_path / 'out'
    assert rsmb('batch', bag, '-o', out)[0] == 0
    os.utime(bag, ns=(1, 1))
    monkeypatch.setattr('rsmb_ros.__version__', '9.9')
    code, _, err = rsmb('batch', bag, '-o', out)
    assert code == 1
    assert 'rsmb_ros was 0.1.0, is 9.9; the input was changed; --again replays it' in err[0]


@pytest.mark.usefixtures('one_process')
def test_missing_output_is_made_again(rsmb, write_bag, tmp_path):
    bag, out = write_bag(tmp_path / 'a.mcap', 1), tmp_path / 'out'
    assert rsmb('batch', bag, '-o', out)[0] == 0
    written = (out / 'a.mcap').read_bytes()
    (out / 'a.mcap').unlink()
    assert rsmb('batch', bag, '-o', out)[0] == 0
    assert (out / 'a.mcap').read_bytes() == written
    assert rsmb('batch', bag, '-o', out, '--csv')[0] == 0  # asked for only now
    assert (out / 'a.csv').is_file()


@pytest.mark.usefixtures('one_process')
def test_names_stay_when_another_bag_of_the_name_comes(rsmb, write_bag, tmp_path):
    first, out = write_bag(tmp_path / 'x' / 'a.mcap', 1), tmp_path / 'out'
    assert rsmb('batch', first, '-o', out)[0] == 0
    second = write_bag(tmp_path / 'y' / 'a.mcap', 2)
    code, lines, _ = rsmb('batch', second, first, '-o', out)
    assert code == 0
    assert '1 done, 1 done before' in lines[-1]
    bags = {name: entry['bag'] for name, entry in entries_of(out).items()}
    assert bags == {'a': str(first), 'y-a': str(second)}


def test_terminal_gets_a_bar_and_only_failures_as_lines(rsmb, write_bag, tmp_path, monkeypatch):
    monkeypatch.setattr('sys.stderr.isatty', lambda: True, raising=False)
    monkeypatch.setenv('TERM', 'xterm')
    bags = [write_bag(tmp_path / f'{n}.mcap', n) for n in range(2)]
    bags[1].write_bytes(b'')
    code, lines, err = rsmb('batch', *bags, '-o', tmp_path / 'out')
    assert code == 1
    shown = '\n'.join([*lines, *err])
    assert 'batch ' in shown
    assert '100%' in shown
    assert '1: failed: ' in shown
    assert '0: done' not in shown


@pytest.mark.usefixtures('one_process')
def test_killed_in_the_middle_of_a_bag_it_goes_on_there(rsmb, write_bag, detected, tmp_path):
    bag, out = write_bag(tmp_path / 'a.mcap', 1, frames=FRAMES), tmp_path / 'out'
    names = {'output': 'a.mcap', 'csv': 'a.csv', 'report': 'a.html'}
    (tmp_path / 'whole').mkdir()
    whole = {field: tmp_path / 'whole' / name for field, name in names.items()}
    replay(ReplayJob(bag, **whole))
    batch = _begun(bag, '-o', out, '--csv', '--report')
    _stop_with_three_frames(batch, out / 'a.mcap.part', signal.SIGKILL)
    part = out / 'a.mcap.part'
    left = len(StoredFrames(part, scan(part)))
    assert 3 <= left < FRAMES
    detected.clear()
    code, lines, err = rsmb('batch', bag, '-o', out, '--csv', '--report')
    assert (code, err) == (0, [])
    assert len(detected) == FRAMES - left
    assert lines[0].startswith(f'a: done, {FRAMES} frames, {left} kept of before, ')
    assert entries_of(out)['a']['counts']['resumed'] == left
    for path in whole.values():
        assert (out / path.name).read_bytes() == path.read_bytes()
    assert not part.exists()


@pytest.fixture
def half_done(write_bag, tmp_path):
    """A bag of four frames, and the folder of a batch that was killed when it had three of them."""
    bag, out = write_bag(tmp_path / 'a.mcap', 1, frames=4), tmp_path / 'out'
    out.mkdir()
    job = BatchJob([Item(bag)], out)
    batch = Batch(job)
    replay(ReplayJob(bag, out / 'a.mcap'))
    part = (out / 'a.mcap').rename(out / 'a.mcap.part')
    with part.open('r+b') as stream:
        stream.truncate(scan(part).end(3) + 100)
    (plan,) = batch.to_do
    batch._manifest.put(batch._entry(plan, PENDING))
    return bag, out


@pytest.mark.usefixtures('one_process')
@pytest.mark.parametrize(
    ('options', 'kept'),
    [
        ((), 3),
        (('--csv',), 3),
        (('--max-frames', 3), 0),
        (('--compress', 'png'), 0),
        (('--keep-input',), 0),
        (('--set', 'change.min_area=0.3'), 0),
    ],
)
def test_half_done_one_is_gone_on_with_if_nothing_else_is_wished(
    options, kept, half_done, rsmb, detected
):
    bag, out = half_done
    assert rsmb('batch', bag, '-o', out, *options)[0] == 0
    assert len(detected) == (3 if '--max-frames' in options else 4) - kept
    assert not (out / 'a.mcap.part').exists()
    written = (out / 'a.mcap').read_bytes()
    assert rsmb('batch', bag, '-o', out / '..' / 'new', *options)[0] == 0
    assert (out / '..' / 'new' / 'a.mcap').read_bytes() == written


@pytest.mark.usefixtures('one_process')
def test_half_done_one_of_another_input_or_version_is_begun_again(
    half_done, rsmb, detected, monkeypatch
):
    bag, out = half_done
    os.utime(bag, ns=(1, 1))  # something in its middle may be another one
    assert rsmb('batch', bag, '-o', out)[0] == 0
    assert len(detected) == 4


@pytest.mark.usefixtures('one_process')
@pytest.mark.parametrize('damage', [b'', b'no recording at all', 20, 2000])
def test_half_done_one_that_is_of_no_use_is_begun_again(damage, half_done, rsmb, detected):
    bag, out = half_done
    part = out / 'a.mcap.part'
    if isinstance(damage, int):  # bytes before the end of the second frame: its index, itself
        flipped = bytearray(part.read_bytes())
        flipped[scan(part).end(2) - damage] ^= 1
        damage = bytes(flipped)
    part.write_bytes(damage)
    code, _, _ = rsmb('batch', bag, '-o', out)
    assert code == 0
    assert len(detected) == 4
    assert entries_of(out)['a']['counts']['resumed'] == 0
    warnings = entries_of(out)['a']['warnings']
    assert all('a.mcap.part' in text and '; all frames are replayed' in text for text in warnings)
    assert len(warnings) == (damage != b'')
    assert rsmb('batch', bag, '-o', out / '..' / 'new')[0] == 0
    assert (out / '..' / 'new' / 'a.mcap').read_bytes() == (out / 'a.mcap').read_bytes()


@pytest.mark.usefixtures('one_process')
def test_output_that_is_asked_for_later_needs_no_detection(rsmb, write_bag, detected, tmp_path):
    bag, out = write_bag(tmp_path / 'a.mcap', 1), tmp_path / 'out'
    assert rsmb('batch', bag, '-o', out)[0] == 0
    written = (out / 'a.mcap').read_bytes()
    detected.clear()
    assert rsmb('batch', bag, '-o', out, '--csv')[0] == 0
    assert detected == []
    assert (out / 'a.mcap').read_bytes() == written
    replay(ReplayJob(bag, tmp_path / 'r.mcap', csv=tmp_path / 'r.csv'))
    assert (out / 'a.csv').read_bytes() == (tmp_path / 'r.csv').read_bytes()
    os.utime(bag, ns=(1, 1))
    detected.clear()
    assert rsmb('batch', bag, '-o', out, '--csv', '--again')[0] == 0
    assert len(detected) == 2


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
def test_stopped_batch_goes_on(number, rsmb, write_bag, tmp_path):
    bags = [write_bag(tmp_path / 'a.mcap', 1), write_bag(tmp_path / 'b.mcap', 2, frames=200)]
    out = tmp_path / 'out'
    batch = _begun(*bags, '-o', out, '--workers', '1')
    part = out / 'b.mcap.part'
    _until(part.exists)
    err = _stop(batch, number)
    assert batch.returncode == (-9 if number == signal.SIGKILL else 130)
    assert ('interrupted' in err) == (number == signal.SIGINT)
    states = {name: entry['status'] for name, entry in entries_of(out).items()}
    assert states == {'a': 'done', 'b': 'pending'}
    assert not (out / 'b.mcap').exists()
    written = times_of(out)['a.mcap']
    write_bag(bags[1], 2, frames=2)  # that it is short now does not matter: it was not done
    code, lines, _ = rsmb('batch', *bags, '-o', out, '--workers', '1')
    assert code == 0
    assert '2 recordings: 1 done, 1 done before' in lines[-1]
    assert times_of(out)['a.mcap'] == written
    assert not part.exists()


def _begun(*arguments):
    """Return a process that runs a batch."""
    command = [sys.executable, '-m', 'rsmb_ros.cli.main', 'batch', *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


def _stop(batch, number):
    """Send a signal to a batch, and return what it says when it and its workers are gone."""
    workers = _children(batch.pid)
    batch.send_signal(number)
    _, err = batch.communicate(timeout=DEADLINE_S)
    _until(lambda: not any(_is_there(pid) for pid in workers))
    return err


def _stop_with_three_frames(batch, part, number):
    """Stop a batch when its unfinished output holds three frames."""

    def enough():
        assert batch.poll() is None, 'it was done before it could be killed'
        found = scan(part) if part.exists() else None
        return found is not None and len(StoredFrames(part, found)) >= 3

    _until(enough)
    _stop(batch, number)


def _until(condition):
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end, 'it did not happen in time'
        time.sleep(0.01)


def _children(pid):
    """Processes below a process; Linux only, as the tests are."""
    with open(f'/proc/{pid}/task/{pid}/children') as stream:
        return [int(text) for text in stream.read().split()]


def _is_there(pid):
    try:
        with open(f'/proc/{pid}/stat') as stream:
            return stream.read().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False
