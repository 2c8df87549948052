"""What a killed replay leaves is gone on with where it ends, to the same bytes."""

import json
import signal

import pytest
from small_flight import masks_of

import rsmb_ros
from rsmb_ros.bags.mcap_scan import scan
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.cli.interrupt import Interrupt
from rsmb_ros.core import Config, Detector
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.replay import detection
from rsmb_ros.replay.job import ReplayJob, replay

LASTING = {'change.persistence_frames': 3, 'change.persistence_seen': 2}
SUFFIXES = ('mcap', 'csv', 'jsonl')


def job(bag, folder, **options):
    """Return a job that writes all that must be equal."""
    folder.mkdir(exist_ok=True)
    texts = {'csv': folder / 'out.csv', 'jsonl': folder / 'out.jsonl'}
    return ReplayJob(bag, folder / 'out.mcap', **texts, **options)


def written(folder):
    return {suffix: (folder / f'out.{suffix}').read_bytes() for suffix in SUFFIXES}


@pytest.fixture(scope='module')
def whole(flight_bag, tmp_path_factory):
    """What an uninterrupted replay writes."""
    folder = tmp_path_factory.mktemp('whole')
    replay(job(flight_bag, folder, keep_input=True))
    return written(folder)


@pytest.fixture
def counted(monkeypatch):
    """Count the frames that are really processed."""

    class Counting(Detector):
        calls = 0

        def detect(self, live, stamp=None):
            Counting.calls += 1
            return super().detect(live, stamp)

    monkeypatch.setattr(detection, 'Detector', Counting)
    return Counting


@pytest.fixture
def cut_off(whole, tmp_path):
    """Return a function that leaves a replay as one that is killed after some frames."""

    def leave(frames, more=0, written=whole):
        folder = tmp_path / 'out'
        folder.mkdir()
        part = folder / 'out.mcap.part'
        part.write_bytes(written['mcap'])
        with part.open('r+b') as stream:
            stream.truncate(scan(part).end(frames) + more)
        for suffix in ('csv', 'jsonl'):
            (folder / f'out.{suffix}').write_text('cut in the mid')
        return folder

    return leave


# -- what is left in whatever state ----------------------------------------------------------------


@pytest.mark.parametrize(('frames', 'more'), [(0, 0), (1, 0), (3, 1000), (6, 0), (6, 40)])
def test_only_the_frames_that_are_missing_are_processed(
    flight_bag, whole, cut_off, counted, frames, more
):
    folder = cut_off(frames, more)
    counted.calls = 0
    summary = replay(job(flight_bag, folder, keep_input=True, resume=True))
    assert counted.calls == 6 - frames
    assert (summary.frames, summary.resumed) == (6, frames)
    assert written(folder) == whole


def test_workers_go_on_with_what_one_process_left(flight_bag, whole, cut_off):
    folder = cut_off(2)
    replay(job(flight_bag, folder, keep_input=True, resume=True, workers=2))
    assert written(folder) == whole


@pytest.mark.parametrize('changes', [LASTING, {'stream.hold': True}])
def test_frames_that_depend_on_earlier_ones_are_computed_again(
    flight_bag, cut_off, counted, tmp_path, changes
):
    config = Config().replaced(changes)
    replay(job(flight_bag, tmp_path / 'whole', config=config))
    folder = cut_off(4, written=written(tmp_path / 'whole'))
    counted.calls = 0
    replay(job(flight_bag, folder, config=config, resume=True))
    assert counted.calls == 6
    assert written(folder) == written(tmp_path / 'whole')


@pytest.mark.parametrize('compress', ['png', 'jpeg'])
def test_compressed_outputs_go_on_too(flight_bag, cut_off, tmp_path, compress):
    replay(job(flight_bag, tmp_path / 'whole', compress=compress))
    folder = cut_off(3, written=written(tmp_path / 'whole'))
    replay(job(flight_bag, folder, compress=compress, resume=True))
    assert written(folder) == written(tmp_path / 'whole')


def test_frames_without_a_result_are_counted_again(photos, factory, tmp_path):
    bag = tmp_path / 'some.mcap'
    with BagWriter(bag) as writer:
        for n, photo in enumerate(photos):
            photo = photo[:20, :20] if n in (2, 4) else photo
            topic = '/image' if n else '/reference/image'
            writer.write(topic, factory.image(factory.header(n, 'cam'), photo), n)
    first = replay(job(bag, tmp_path / 'out'))
    again = replay(job(bag, tmp_path / 'out', resume=True))
    assert (first.frames, first.skipped, first.resumed) == (4, 2, 0)
    assert (again.frames, again.skipped, again.resumed) == (4, 2, 4)


def test_interrupted_replay_goes_on_although_it_has_its_name(flight_bag, whole, tmp_path):
    def stopping(items, total, what):
        with Interrupt() as interrupt:
            for n, item in enumerate(items):
                if n == 3:
                    signal.raise_signal(signal.SIGINT)
                interrupt.check()
                yield item

    with pytest.raises(KeyboardInterrupt):
        replay(job(flight_bag, tmp_path, keep_input=True), stopping)
    assert len(masks_of(tmp_path / 'out.mcap')) == 3
    summary = replay(job(flight_bag, tmp_path, keep_input=True, resume=True))
    assert summary.resumed == 3
    assert written(tmp_path) == whole


def test_finished_replay_stays_as_it_is_and_may_get_more_files(
    flight_bag, whole, tmp_path, counted
):
    replay(ReplayJob(flight_bag, tmp_path / 'out.mcap', keep_input=True))
    counted.calls = 0
    replay(job(flight_bag, tmp_path, keep_input=True, resume=True))
    assert counted.calls == 0
    assert written(tmp_path) == whole


def test_with_nothing_left_it_starts(flight_bag, whole, tmp_path):
    assert replay(job(flight_bag, tmp_path, keep_input=True, resume=True)).resumed == 0
    assert written(tmp_path) == whole


# -- refusals --------------------------------------------------------------------------------------


def test_without_resume_nothing_is_lost(flight_bag, cut_off):
    folder = cut_off(4, more=9)
    before = (folder / 'out.mcap.part').read_bytes()
    with pytest.raises(ConfigError, match='with 4 frames; go on with --resume, or delete it'):
        job(flight_bag, folder)
    assert (folder / 'out.mcap.part').read_bytes() == before


@pytest.mark.parametrize(
    ('options', 'told'),
    [
        ({'config': Config().replaced({'change.threshold_high': 6.0})},
         r'change\.threshold_high was 5\.0, is 6\.0'),
        ({'keep_input': False}, 'keep_input was True, is False'),
        ({'compress': 'png'}, 'compress was None, is png'),
        ({'reference': '@0'}, r'reference was /reference/image, is uint8 \(96, 128\)'),
    ],
)  # fmt: skip
def test_another_job_is_refused_and_touches_nothing(flight_bag, cut_off, options, told):
    folder = cut_off(2)
    before = (folder / 'out.mcap.part').read_bytes()
    with pytest.raises(ConfigError, match=told):
        replay(job(flight_bag, folder, **{'keep_input': True, 'resume': True, **options}))
    assert (folder / 'out.mcap.part').read_bytes() == before
    assert not (folder / 'out.mcap').exists()


def test_another_version_is_refused(flight_bag, cut_off, monkeypatch):
    folder = cut_off(2)
    monkeypatch.setattr(rsmb_ros, '__version__', '99.0')
    with pytest.raises(ConfigError, match=r'version was .*, is 99\.0'):
        replay(job(flight_bag, folder, keep_input=True, resume=True))


def test_another_input_is_refused(flight_bag, photos, factory, cut_off, tmp_path):
    folder = cut_off(2)
    other = tmp_path / flight_bag.name
    with BagWriter(other) as bag:
        for n, photo in enumerate(reversed(photos)):
            topic = '/image' if n else '/reference/image'
            bag.write(topic, factory.image(factory.header(n, 'cam'), photo), n)
    with pytest.raises(ConfigError, match=r'input\.fingerprint was \w+, is \w+'):
        replay(job(other, folder, keep_input=True, resume=True))


def test_other_recordings_of_ours_are_refused(flight_bag, photos, factory, tmp_path):
    with BagWriter(tmp_path / 'out.mcap', Config()) as bag:
        bag.write('/image', factory.image(factory.header(1, ''), photos[0]), 1)
    before = (tmp_path / 'out.mcap').read_bytes()
    with pytest.raises(ConfigError, match=r'out\.mcap was not written by rsmb replay'):
        replay(job(flight_bag, tmp_path, resume=True))
    assert (tmp_path / 'out.mcap').read_bytes() == before


def test_file_of_another_program_is_refused(flight_bag, tmp_path):
    (tmp_path / 'out.mcap').write_bytes(b'SQLite format 3\0')
    with pytest.raises(BagError, match=r'out\.mcap: no \.mcap file'):
        replay(job(flight_bag, tmp_path, resume=True))
    assert (tmp_path / 'out.mcap').exists()


def test_lines_of_json_tell_each_frame(whole):
    lines = [json.loads(line) for line in whole['jsonl'].splitlines()]
    assert [line['frame'] for line in lines] == list(range(6))
    assert {'stamp', 'status', 'reason', 'exposure_rows', 'regions'} <= set(lines[0])
    assert all('timings_ms' not in line for line in lines)
