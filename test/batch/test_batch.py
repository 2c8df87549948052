"""`rsmb batch`: many recordings, one of them broken."""

import json
import re

import pytest

from rsmb_ros.replay.job import ReplayJob, replay


@pytest.fixture(scope='module')
def eight(write_bag, tmp_path_factory):
    """Folder with eight bags, two of one name; that of day 2 is broken."""
    folder = tmp_path_factory.mktemp('flights')
    for n in range(6):
        write_bag(folder / f'f{n}.mcap', n)
    write_bag(folder / 'day1' / 'flight.mcap', 6)
    broken = write_bag(folder / 'day2' / 'flight.mcap', 7)
    broken.write_bytes(broken.read_bytes()[:200])
    return folder


@pytest.fixture(scope='module')
def batched(eight, tmp_path_factory):
    """What `rsmb batch` says and leaves: (exit code, stdout, stderr, folder)."""
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    from rsmb_ros.cli.main import main

    folder, out, err = tmp_path_factory.mktemp('out'), StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        options = ['--csv', '--report', '--workers', '2']
        code = main(['batch', str(eight), '-o', str(folder), *options])
    return code, out.getvalue().splitlines(), err.getvalue().splitlines(), folder


def test_seven_of_eight_are_done_and_one_is_explained(batched):
    code, out, err, _ = batched
    assert code == 1
    done = [line for line in out if ': done, 2 frames, ' in line]
    assert sorted(line.split(':')[0] for line in done) == [
        'day1-flight',
        *(f'f{n}' for n in range(6)),
    ]
    assert len(out) == 8
    assert re.match(r'8 recordings: 7 done, 1 failed; 14 frames in [\d.]+ s, ', out[-1])
    (line,) = err
    assert line.startswith('rsmb: error: day2-flight: failed: ')
    assert re.search(r'day2/flight\.mcap: none of its messages can be read; copy', line)


def test_manifest_tells_what_became_of_each(batched):
    entries = {
        one['name']: one for one in json.loads((batched[3] / 'manifest.json').read_text())['bags']
    }
    assert {one['status'] for name, one in entries.items() if name != 'day2-flight'} == {'done'}
    broken = entries['day2-flight']
    assert (broken['status'], broken['counts']) == ('failed', None)
    assert 'none of its messages can be read' in broken['reason']
    assert broken['warnings']
    one = entries['f3']
    wanted = {'frames': 2, 'skipped': 0, 'lost': 0, 'registered': 2, 'changes': 1, 'resumed': 0}
    assert one['counts'] == wanted
    assert one['outputs'] == ['f3.mcap', 'f3.csv', 'f3.html']
    assert one['seconds'] > 0


def test_outputs_are_those_of_replay_byte_by_byte(batched, eight, tmp_path):
    for name, source in (('f0', 'f0.mcap'), ('day1-flight', 'day1/flight.mcap')):
        files = {field: tmp_path / f'{name}{end}' for field, end in _ENDS.items()}
        replay(ReplayJob(eight / source, **files))
        for path in files.values():
            assert (batched[3] / path.name).read_bytes() == path.read_bytes()
    assert not list(batched[3].glob('*.part'))


_ENDS = {'output': '.mcap', 'csv': '.csv', 'report': '.html'}


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['-o', 'out'], 'no recordings: name bags or folders, or list them in --manifest FILE'),
        (['x.bag', '-o', 'o', '--scheduler', 's', '--workers', '2'], '--workers 2 is for this mac'),
        (['x.bag', '-o', 'o', '--workers', '0'], "'0' must be a number from 1 to 256"),
        (['x.bag', '-o', 'o', '--set', 'change.min_aera=1'], 'did you mean change.min_area'),
    ],
)
def test_bad_usage_is_told(arguments, reason, rsmb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = rsmb('batch', *arguments)
    assert (code, out) == (2, [])
    assert reason in err[-1]


def test_output_never_replaces_an_input(rsmb, write_bag, tmp_path):
    bag = write_bag(tmp_path / 'in' / 'one.mcap', 1)
    other = write_bag(tmp_path / 'out' / 'in-one.mcap', 2)
    before = other.read_bytes()
    code, _, err = rsmb('batch', bag, bag.parent / '..' / 'out' / 'in-one.mcap', '-o', bag.parent)
    assert code == 2
    assert 'one.mcap is to be read, and would be written for' in err[0]
    assert other.read_bytes() == before
    assert not (bag.parent / 'manifest.json').exists()


def test_folder_in_use_is_left_to_the_other_batch(rsmb, tmp_path):
    from rsmb_ros.batch.manifest import only_batch

    with only_batch(tmp_path):
        code, _, err = rsmb('batch', 'x.bag', '-o', tmp_path)
    assert code == 1
    assert f'{tmp_path}: another rsmb batch is writing there' in err[0]
    assert rsmb('batch', '-o', tmp_path)[0] == 2  # the lock is gone
