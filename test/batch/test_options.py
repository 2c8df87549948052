"""What a batch asks of each replay: the cores it may use, and what it writes."""

import json

import pytest

from rsmb_ros.batch.batch import Batch, BatchJob
from rsmb_ros.batch.items import Item
from rsmb_ros.core import Config
from rsmb_ros.replay.geojson_sink import GeoOptions
from rsmb_ros.replay.job import ReplayJob, replay

FOCAL = ('--set', 'camera.focal_px=200')
MAP = ('--geojson', '--heading', '10', '--height', '40')


@pytest.fixture
def bag(write_bag, tmp_path):
    """A bag of two frames with fixes."""
    return write_bag(tmp_path / 'a.mcap', 1, fixes=True)


def threads(folder, cores, recordings, **settings):
    """Return the threads that a batch gives to each of its recordings."""
    config = Config().replaced(settings)
    items = [Item(folder / f'{n}.mcap', config=config) for n in range(recordings)]
    batch = Batch(BatchJob(items, folder / 'out', workers=cores))
    (given,) = {batch._task(plan).options['threads'] for plan in batch.to_do}
    return given


@pytest.mark.parametrize(
    ('cores', 'recordings', 'wanted'),
    [(1, 8, 1), (2, 8, 1), (8, 8, 1), (8, 4, 2), (8, 3, 2), (8, 1, 8), (1, 1, 1), (None, 1, 1)],
)
def test_cores_are_shared_out_among_the_recordings_at_once(cores, recordings, wanted, tmp_path):
    assert threads(tmp_path, cores, recordings) == wanted
    assert threads(tmp_path, cores, recordings, **{'worker.threads': 3}) == 3


def test_threads_are_of_those_that_are_left_to_do(rsmb, write_bag, tmp_path, monkeypatch):
    asked = []

    class Crew:
        def __init__(self, count):
            self.count = count

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def results(self, tasks, pulse):
            asked.append((self.count, [task.options['threads'] for task in tasks]))
            from rsmb_ros.batch.tasks import carried_out

            yield from map(carried_out, tasks)

    monkeypatch.setattr('rsmb_ros.cli.batch.LocalCrew', Crew)
    bags, out = [write_bag(tmp_path / f'{n}.mcap', n) for n in range(3)], tmp_path / 'out'
    assert rsmb('batch', *bags[:2], '-o', out, '--workers', 4)[0] == 0
    assert rsmb('batch', *bags, '-o', out, '--workers', 4)[0] == 0
    assert asked == [(4, [2, 2]), (4, [4])]


@pytest.mark.usefixtures('one_process')
@pytest.mark.parametrize('compress', ['png', 'jpeg'])
def test_outputs_are_those_of_replay_with_the_same_options(compress, rsmb, bag, tmp_path):
    out, config = tmp_path / 'out', Config().replaced({'camera.focal_px': 200.0})
    code, _, err = rsmb(
        'batch', bag, '-o', out, '--compress', compress, '--keep-input', *MAP, *FOCAL
    )
    assert (code, err) == (0, [])
    geo = GeoOptions(tmp_path / 'r.geojson', heading=10.0, height=40.0)
    wanted = ReplayJob(
        bag, tmp_path / 'r.mcap', config=config, compress=compress, keep_input=True, geojson=geo
    )
    assert replay(wanted).changes > 0
    for end in ('mcap', 'geojson'):
        assert (out / f'a.{end}').read_bytes() == (tmp_path / f'r.{end}').read_bytes()
    (entry,) = json.loads((out / 'manifest.json').read_text())['bags']
    assert entry['outputs'] == ['a.mcap', 'a.geojson']
    told = {'compress': compress, 'keep_input': True, 'heading': 10.0, 'height': 40.0}
    assert entry['wish']['settings'] == {'camera.focal_px': 200.0, **told}


@pytest.mark.usefixtures('one_process')
def test_output_otherwise_compressed_is_told(rsmb, bag, tmp_path):
    out = tmp_path / 'out'
    assert rsmb('batch', bag, '-o', out, '--compress', 'png')[0] == 0
    code, _, err = rsmb('batch', bag, '-o', out, '--keep-input')
    assert code == 1
    assert 'compress was png, is not given; keep_input was not given, is True; --again' in err[0]


@pytest.mark.usefixtures('one_process')
def test_map_may_come_later_and_its_options_matter_with_it_alone(rsmb, bag, detected, tmp_path):
    command = ('batch', bag, '-o', tmp_path / 'out', *FOCAL)
    path = tmp_path / 'out' / 'a.geojson'
    assert rsmb(*command)[0] == 0
    detected.clear()
    assert rsmb(*command, *MAP)[0] == 0
    first = path.read_bytes()
    lower = (*MAP[:-1], '30')
    code, _, err = rsmb(*command, *lower)
    assert code == 1
    assert 'a: left as it was done: height was 40.0, is 30.0; --again replays it' in err[0]
    assert path.read_bytes() == first
    code, lines, _ = rsmb(*command)
    assert (code, '1 done before' in lines[-1]) == (0, True)
    assert rsmb(*command, *lower, '--again')[0] == 0
    assert path.read_bytes() != first
    assert rsmb(*command, '--csv')[0] == 0  # now nothing is known of the map that is there
    assert rsmb(*command, *MAP)[0] == 0
    assert path.read_bytes() == first
    assert detected == []


@pytest.mark.parametrize(
    ('options', 'told'),
    [
        (['--geojson', '--height', '40'], '--geojson needs --heading'),
        (['--fix', '/fix'], '--fix is for --geojson, which is missing'),
        (['--compress', 'gif'], "invalid choice: 'gif'"),
    ],
)
def test_options_that_do_not_go_together_are_told_at_once(options, told, rsmb, bag, tmp_path):
    code, _, err = rsmb('batch', bag, '-o', tmp_path / 'out', *options)
    assert code == 2
    assert told in err[-1]
    assert not (tmp_path / 'out').exists()
