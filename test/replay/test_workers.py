"""Any number of processes writes the same bytes."""

import errno
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from small_flight import masks_of

from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core import Config, Detector
from rsmb_ros.core.errors import ConfigError, FileProblem, FrameError, RsmbError
from rsmb_ros.core.settled import settled
from rsmb_ros.replay.job import ReplayJob, replay
from rsmb_ros.replay.pairs import Reference
from rsmb_ros.replay.recording_sink import RecordingSink
from rsmb_ros.replay.workers import WorkerPool, threads_each

LASTING = {'change.persistence_frames': 3, 'change.persistence_seen': 2}


@pytest.fixture
def changing_bag(photos, factory, tmp_path):
    """Two references, frames before and after, one that is too small for the detector."""
    path = tmp_path / 'changing.mcap'
    order = [('/reference/image', 0), ('/image', 1), ('/image', 3), ('/image', 4), ('/image', 5)]
    order += [('/reference/image', 4), ('/image', 2), ('/image', 6), ('/image', 1)]
    with BagWriter(path) as bag:
        for time, (topic, n) in enumerate(order, 1):
            photo = photos[n][:20, :20] if time == 3 else photos[n]
            bag.write(topic, factory.image(factory.header(time * 10**8, 'cam'), photo), time)
    return path


def test_output_is_equal_byte_by_byte(changing_bag, tmp_path):
    config = Config().replaced(LASTING)
    written = []
    for count in (1, 3):
        out, table = tmp_path / f'{count}.mcap', tmp_path / f'{count}.csv'
        job = ReplayJob(changing_bag, out, config=config, workers=count, csv=table)
        summary = replay(job)
        assert (summary.frames, summary.skipped) == (6, 1)
        assert summary.changes > 0
        written.append((out.read_bytes(), table.read_bytes()))
    assert written[0] == written[1]


def test_threads_of_a_worker_do_not_matter(photos):
    wanted = settled(Detector(photos[0], config=Config()).detect(photos[3]))
    with WorkerPool(1, None, Config().replaced({'worker.threads': 5}), None) as pool:
        found = pool.submit(Reference(0, photos[0]), photos[3]).result(60).result
    for name in ('change_mask', 'valid_mask', 'residual', 'registered', 'rectified'):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    assert found.regions == wanted.regions


def test_cores_are_shared_out_unless_threads_are_set(monkeypatch):
    monkeypatch.setattr(os, 'cpu_count', lambda: 8)
    assert [threads_each(count, Config()) for count in (2, 3, 8, 12)] == [4, 2, 1, 1]
    assert [threads_each(count, Config(), cores=6) for count in (1, 4, 6)] == [6, 1, 1]
    assert threads_each(4, Config().replaced({'worker.threads': 3}), cores=4) == 3


def test_stream_that_is_held_needs_one_process(flight_bag, tmp_path):
    config = Config().replaced({'stream.hold': True})
    with pytest.raises(ConfigError, match=r'--workers 2: with stream\.hold = true each frame'):
        ReplayJob(flight_bag, tmp_path / 'o.mcap', config=config, workers=2)
    with pytest.raises(ConfigError, match='--workers 0 must be from 1 to 256'):
        ReplayJob(flight_bag, tmp_path / 'o.mcap', workers=0)


def test_error_of_a_frame_comes_back(photos):
    with WorkerPool(1, None, Config(), None) as pool:
        small = pool.submit(Reference(0, photos[0]), photos[1][:9, :9])
        with pytest.raises(FrameError, match='live frame is 9x9 px'):
            small.result(60)
        good = pool.submit(Reference(0, photos[0]), photos[1])
        assert good.result(60).result.status == 'registered'


def test_worker_that_dies_is_told(photos):
    with WorkerPool(1, None, Config(), None) as pool:
        os.kill(pool._workers[0]._process.pid, signal.SIGKILL)
        asked = pool.submit(Reference(0, photos[0]), photos[1])
        with pytest.raises(RsmbError, match=r'worker 0 .* exit code -9 .*use fewer --workers'):
            asked.result(60)


def test_interrupted_replay_leaves_a_readable_file_and_no_process(
    flight_bag, tmp_path, monkeypatch
):
    pools = []

    class Watched(WorkerPool):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            pools.append([worker._process.pid for worker in self._workers])

    def interrupted(items, total, what):
        for n, item in enumerate(items):
            if n == 3:
                raise KeyboardInterrupt
            yield item

    monkeypatch.setattr('rsmb_ros.replay.job.WorkerPool', Watched)
    out = tmp_path / 'out.mcap'
    with pytest.raises(KeyboardInterrupt):
        replay(ReplayJob(flight_bag, out, workers=2), interrupted)
    assert len(masks_of(out)) == 3
    for pid in pools[0]:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.parametrize('threads', [None, 1, 2])
def test_failing_sink_ends_the_replay(flight_bag, tmp_path, threads):
    full, out = Path('/dev/full'), tmp_path / 'o.mcap'
    with pytest.raises(FileProblem, match='/dev/full: cannot be written: No space left'):
        replay(ReplayJob(flight_bag, out, csv=full, threads=threads))


@pytest.fixture
def takes(monkeypatch):
    """Return a list of (thread, frame) of what sinks take; the third frame fails if told so."""

    class Takes(list):
        fails = False

    found, take = Takes(), RecordingSink.take

    def taken(sink, frame, reference, result):
        found.append((threading.get_ident(), frame.index))
        if found.fails and len(found) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), 'o.mcap')
        take(sink, frame, reference, result)

    monkeypatch.setattr(RecordingSink, 'take', taken)
    return found


@pytest.mark.parametrize('threads', [None, 1, 2])
def test_disk_that_is_full_in_the_middle_ends_the_replay(flight_bag, tmp_path, takes, threads):
    takes.fails = True
    with pytest.raises(OSError, match='No space left on device'):
        replay(ReplayJob(flight_bag, tmp_path / 'o.mcap', threads=threads))
    assert [index for _, index in takes] == [0, 1, 2]  # nothing behind a gap
    assert len(masks_of(tmp_path / 'o.mcap')) == 2


def test_one_thread_writes_what_it_detects(flight_bag, tmp_path, takes):
    own, written = threading.get_ident(), []
    for threads in (None, 2, 1):
        takes.clear()
        before = set(threading.enumerate())
        replay(ReplayJob(flight_bag, tmp_path / 'o.mcap', threads=threads))
        assert [index for _, index in takes] == list(range(6))
        assert ({ident for ident, _ in takes} == {own}) == (threads == 1)
        if threads == 1:
            assert set(threading.enumerate()) == before
        written.append((tmp_path / 'o.mcap').read_bytes())
    assert written[0] == written[1] == written[2]
