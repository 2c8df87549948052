"""Damaged bags give what is whole in them, and say what is not."""

import os
import struct

import numpy as np
import pytest
from containers import in_container

from rsmb_ros.bags.check import check
from rsmb_ros.bags.mcap_records import Chunk
from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import BagError

COUNT = 24
STEP_NS = 100_000_000
FLIPS = int(os.environ.get('RSMB_FUZZ', 60))


@pytest.fixture(scope='session')
def images(texture_of):
    """Many small images: together some blocks of any compression but bz2."""
    return [texture_of(120, 160, seed) for seed in range(COUNT)]


@pytest.fixture(scope='session')
def whole_bag(images, factory, tmp_path_factory):
    """Bag with /image COUNT times and /camera_info once, one chunk."""
    path = tmp_path_factory.mktemp('whole') / 'whole.mcap'
    with BagWriter(path) as bag:
        info = factory.camera_info(factory.header(0, ''), images[0].shape, 50.0)
        bag.write('/camera_info', info, 0)
        for index, image in enumerate(images):
            time_ns = (index + 1) * STEP_NS
            header = factory.header(time_ns, 'cam')
            bag.write('/image', factory.image(header, image), time_ns)
    return path


@pytest.fixture
def contained(whole_bag, tmp_path):
    """Return a function: the bag in a container, as one file."""

    def contained(kind):
        return in_container(whole_bag, kind, tmp_path)

    return contained


def frames_of(path):
    """Return what can be read: [(index, stamp, image)], and whether losses were told."""
    with Bag(path) as bag:
        found = [(f.index, f.stamp_ns, f.image) for f in bag.frames('/image')]
        return found, bool(bag.damage) or bool(bag.skipped['/image'])


def assert_whole(found, images):
    """Every frame is one of the undamaged bag, in its order."""
    stamps = [stamp for _, stamp, _ in found]
    assert stamps == sorted(set(stamps))
    for _, stamp, image in found:
        np.testing.assert_array_equal(image, images[stamp // STEP_NS - 1])


# -- cut off -----------------------------------------------------------------------------------

CUT = ('mcap zstd', 'mcap lz4', 'mcap none', 'mcap small chunks', 'mcap unchunked', 'db3')


@pytest.mark.parametrize('kind', [*CUT, 'bag', 'bag lz4'])
def test_bag_cut_at_half_its_length_gives_the_frames_before(contained, images, kind, caplog):
    path = contained(kind)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    found, told = frames_of(path)
    assert told
    assert_whole(found, images)
    first = len(found)
    assert COUNT // 5 <= first < COUNT
    assert [index for index, _, _ in found] == list(range(first))
    assert str(path) in caplog.text


def test_bag_without_one_whole_message_is_refused(contained):
    path = contained('bag bz2')  # a block of bz2 is larger than all of this bag
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(BagError, match=r'one\.bag: none of its messages can be read; copy the'):
        Bag(path)


@pytest.mark.parametrize('kind', CUT)
def test_bag_cut_anywhere_gives_frames_or_says_why_not(contained, images, kind):
    path = contained(kind)
    data = path.read_bytes()
    rng = np.random.default_rng(20261122)
    counts = []
    for length in sorted(rng.integers(0, len(data), 25)):
        path.write_bytes(data[:length])
        try:
            found, told = frames_of(path)
        except BagError as error:
            assert str(path) in str(error)
            continue
        assert told
        assert_whole(found, images)
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] > COUNT // 2


def test_recording_without_metadata_is_read_file_by_file(whole_bag, images, tmp_path, caplog):
    folder = in_container(whole_bag, 'folder mcap split without metadata', tmp_path)
    found, told = frames_of(folder)
    assert told
    assert_whole(found, images)
    assert len(found) == COUNT
    assert f'{folder}: no metadata.yaml, the recording was not finished; the 2 files' in caplog.text


# -- flipped bytes -----------------------------------------------------------------------------


def chunks_of(path):
    with Bag(path) as bag:
        (reader,) = bag._reader.readers
        return list(reader.storage._contents.chunks)


def test_damaged_chunk_is_skipped_counted_and_named(contained, images, caplog):
    path = contained('mcap small chunks')
    chunks: list[Chunk] = chunks_of(path)
    assert len(chunks) >= 3
    hurt = chunks[1]
    data = bytearray(path.read_bytes())
    data[hurt.data_at + hurt.data_size // 2] ^= 0x10
    path.write_bytes(data)
    with Bag(path) as bag:
        found = [(f.index, f.stamp_ns, f.image) for f in bag.frames('/image')]
        again = list(bag.frames('/image'))
        lost = sum(hurt.counts.values())
        assert bag.damage.lost == lost > 0
    assert_whole(found, images)
    assert len(found) == len(again) == COUNT - lost
    (told,) = (record.getMessage() for record in caplog.records)
    assert f'{path}: chunk at byte {hurt.offset} is damaged' in told
    assert f'its messages are skipped: {lost} of /image; copy the file again' in told


def test_bag_without_its_index_is_walked_through(contained, images, caplog):
    path = contained('mcap small chunks')
    data = bytearray(path.read_bytes())
    data[-20] ^= 1  # in the footer
    path.write_bytes(data)
    found, told = frames_of(path)
    assert told
    assert len(found) == COUNT
    assert_whole(found, images)
    assert f'{path}: no index: ' in caplog.text


def test_index_without_a_crc_that_says_wrong_times_is_told(contained, images, caplog):
    path = contained('mcap without crc')
    first = chunks_of(path)[0]
    data = path.read_bytes()
    told = struct.pack('<Q', first.offset)  # stands behind the times in the index
    at = data.rindex(told) - 16
    path.write_bytes(data[:at] + struct.pack('<Q', 10**12) + data[at + 8 :])
    found, told = frames_of(path)
    assert told
    assert len(found) == COUNT
    assert f'{path}: its index is damaged: messages come in a wrong order' in caplog.text


def test_walk_goes_on_behind_a_record_of_wrong_length(contained, images):
    path = contained('mcap small chunks')
    chunks = chunks_of(path)
    data = bytearray(path.read_bytes())
    data[-20] ^= 1
    data[chunks[1].offset + 3] ^= 0x40
    path.write_bytes(data)
    found, told = frames_of(path)
    assert told
    assert_whole(found, images)
    assert COUNT // 2 < len(found) < COUNT


def flipped(data, rng, most):
    """Return `data` with up to `most` bytes changed."""
    damaged = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, most + 1)):
        damaged[place] ^= rng.integers(1, 256)
    return damaged


@pytest.mark.parametrize('most', [1, 12])
def test_flipped_bytes_are_never_silently_wrong(contained, images, most):
    path = contained('mcap small chunks')
    data = path.read_bytes()
    rng = np.random.default_rng(20261122 + most)
    partly = 0
    for _ in range(FLIPS):
        path.write_bytes(flipped(data, rng, most))
        try:
            found, told = frames_of(path)
        except BagError as error:
            assert str(path) in str(error)
            continue
        assert_whole(found, images)
        assert told or len(found) == COUNT
        partly += 0 < len(found) < COUNT
    assert partly > FLIPS // 10


@pytest.mark.parametrize('kind', ['mcap unchunked', 'db3', 'bag', 'bag lz4'])
def test_flipped_bytes_where_nothing_checks_them_end_in_no_other_error(contained, kind):
    path = contained(kind)
    data = path.read_bytes()
    rng = np.random.default_rng(20261123)
    for _ in range(FLIPS // 2):
        path.write_bytes(flipped(data, rng, 12))
        try:
            for _, _, image in frames_of(path)[0]:
                assert image.dtype == np.uint8
        except BagError as error:
            assert str(path) in str(error)


def test_unchunked_bag_whose_crc_is_wrong_is_told(contained, caplog):
    path = contained('mcap unchunked')
    data = bytearray(path.read_bytes())
    data[data.rindex(b'mono8') + 200] ^= 1  # a pixel of the last image
    path.write_bytes(data)
    found, told = frames_of(path)
    assert told
    assert len(found) == COUNT
    assert 'at least one message is damaged, which one cannot be told' in caplog.text


def test_message_whose_own_compression_is_damaged_is_skipped(whole_bag, images, tmp_path):
    folder = in_container(whole_bag, 'folder db3 message zstd', tmp_path)
    (path,) = folder.glob('*.db3')
    data = bytearray(path.read_bytes())
    magic = b'\x28\xb5\x2f\xfd'
    data[data.index(magic, len(data) // 2) + 1] ^= 0xFF
    path.write_bytes(data)
    with Bag(folder) as bag:
        found = [(f.index, f.stamp_ns, f.image) for f in bag.frames('/image')]
        assert bag.skipped['/image'] == 1
    assert len(found) == COUNT - 1
    assert_whole(found, images)


# -- check -------------------------------------------------------------------------------------


def test_check_of_a_whole_bag(whole_bag):
    found = check(whole_bag)
    assert not found.damaged
    assert found.lines == [
        '/camera_info (sensor_msgs/msg/CameraInfo): 1 of 1 messages whole',
        f'/image (sensor_msgs/msg/Image): {COUNT} of {COUNT} messages whole',
    ]


def test_check_says_what_nothing_checks(contained):
    found = check(contained('mcap unchunked'))
    assert not found.damaged
    assert f'0 chunks and {COUNT + 1} messages outside chunks have no CRC' in found.lines[-1]
    assert 'has no CRC; damage inside of messages cannot' in check(contained('db3')).lines[-1]


def test_check_finds_every_damage(contained):
    path = contained('mcap small chunks')
    hurt = chunks_of(path)[-1]
    data = bytearray(path.read_bytes())
    data[hurt.data_at + 30] ^= 4
    path.write_bytes(data)
    found = check(path)
    assert found.damaged
    lost = sum(hurt.counts.values())
    assert f'{COUNT - lost} of {COUNT} messages whole, {lost} missing' in found.lines[1]
    assert f'chunk at byte {hurt.offset} is damaged' in found.lines[-1]
