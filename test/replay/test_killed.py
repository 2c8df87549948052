"""A replay in a process of its own, killed without a word."""

import random
import shutil
import signal
import struct
import subprocess
import sys
import time

import pytest
import zstandard
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from small_flight import flown, masks_of

from rsmb_ros.replay.job import ReplayJob, replay

TIMES = 2
FILES = ('out.mcap', 'out.csv', 'out.jsonl')


@pytest.fixture(scope='module')
def long_bag(photos, factory, tmp_path_factory):
    """Bag with the frames of the small flight again and again: most are still to come at a kill."""
    path = tmp_path_factory.mktemp('long') / 'flight.mcap'
    return flown(path, factory, photos[:1] + photos[1:] * 8)


def topics_read(path):
    """Return the topics of all messages that the library reads before a file ends somewhere."""
    topics, found = {}, []
    with path.open('rb') as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    found.append(topics[record.channel_id])
        except (EndOfFile, struct.error, zstandard.ZstdError):
            return found
    raise AssertionError(f'{path} has an end')


def test_killed_again_and_again_it_ends_with_the_same_bytes(long_bag, tmp_path):
    (tmp_path / 'whole').mkdir()
    whole, cut = ([folder / name for name in FILES] for folder in (tmp_path / 'whole', tmp_path))
    replay(ReplayJob(long_bag, whole[0], csv=whole[1], jsonl=whole[2]))
    command = [sys.executable, '-m', 'rsmb_ros.cli.main', 'replay', long_bag, '--resume']
    command += ['-o', cut[0], '--csv', cut[1], '--jsonl', cut[2]]
    part = tmp_path / 'out.mcap.part'
    rng, deadline = random.Random(20261122), time.monotonic() + 100
    for _ in range(TIMES):
        before = part.stat().st_size if part.exists() else 0
        size = whole[0].stat().st_size
        goal = before + rng.randrange(size // 20, size // (2 * TIMES))
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        while not (part.exists() and part.stat().st_size >= goal):
            assert process.poll() is None, 'it was done before it could be killed'
            assert time.monotonic() < deadline
            time.sleep(0.0005)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        read = topics_read(part)
        assert read.count('/rsmb/overlay') == read.count('/rsmb/diagnostics') > 0
        shutil.copy(part, tmp_path / 'left.mcap')  # this is how people look into it
        assert len(masks_of(tmp_path / 'left.mcap')) == read.count('/rsmb/diagnostics')
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert 'kept of an earlier replay' in done.stdout
    assert [path.read_bytes() for path in cut] == [path.read_bytes() for path in whole]
    assert not part.exists()
