"""A recording that was cut anywhere keeps its whole chunks, and can be gone on with."""

import struct
from io import BytesIO

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from rsmb_ros.bags.mcap_scan import messages, scan
from rsmb_ros.bags.writing import BagWriter, Kept
from rsmb_ros.core.errors import BagError

FRAMES = 5


def write_frame(writer, factory, n):
    """Write one chunk; frame 2 brings a new topic, frame 3 has one message less."""
    writer.write('/a', factory.text(f'a{n}' * 50), 10 * n)
    if n != 3:
        writer.write('/b', factory.text(f'b{n}'), 10 * n + 1)
    if n >= 2:
        writer.write('/late', factory.text('late'), 10 * n + 2)
    writer.flush()


@pytest.fixture
def whole(tmp_path, factory):
    """Bytes of an uninterrupted recording."""
    with BagWriter(tmp_path / 'whole.mcap', notes={'note': 'kept'}, chunk_bytes=None) as writer:
        for n in range(FRAMES):
            write_frame(writer, factory, n)
    return (tmp_path / 'whole.mcap').read_bytes()


@pytest.fixture
def left(tmp_path):
    """Return a writer of the unfinished ``out.mcap`` that a killed process leaves."""

    def leave(data):
        path = tmp_path / 'out.mcap.part'
        path.write_bytes(data)
        return path

    return leave


def test_recording_cut_at_any_byte_goes_on_to_the_same_bytes(whole, left, factory, tmp_path):
    counts = set()
    for size in range(0, len(whole), 7):
        found = scan(left(whole[:size]))
        if found is None:
            counts.add(None)
            continue
        counts.add(len(found.chunks))
        kept = Kept(found, len(found.chunks))
        if not found.metadata:  # nothing but the header: nobody goes on with that
            assert not found.chunks
            continue
        with BagWriter(tmp_path / 'out.mcap', chunk_bytes=None, kept=kept) as writer:
            for n in range(len(found.chunks), FRAMES):
                write_frame(writer, factory, n)
        assert (tmp_path / 'out.mcap').read_bytes() == whole, f'cut at {size}'
    assert counts == {None, *range(FRAMES + 1)}


def test_finished_recording_is_cut_to_any_number_of_chunks(whole, left, factory, tmp_path):
    for count in range(FRAMES + 1):
        found = scan(left(whole))
        assert len(found.chunks) == FRAMES
        kept = Kept(found, count)
        with BagWriter(tmp_path / 'out.mcap', chunk_bytes=None, kept=kept) as writer:
            for n in range(count, FRAMES):
                write_frame(writer, factory, n)
        assert (tmp_path / 'out.mcap').read_bytes() == whole


def test_unfinished_recording_is_readable_up_to_its_last_chunk(whole, left):
    found = scan(left(whole))
    cut = found.chunks[2].end + 20  # inside the fourth chunk
    seen = []
    with pytest.raises((EndOfFile, struct.error)):
        for record in StreamReader(BytesIO(whole[:cut]), validate_crcs=True).records:
            seen.append(record)
    assert sum(type(record).__name__ == 'Message' for record in seen) == 7


def test_chunk_can_be_read_alone(whole, left):
    path = left(whole)
    found = scan(path)
    contents = found.contents(FRAMES)
    stored = list(messages(path, found.chunks[3], contents))
    assert [(one.topic, one.type, one.time_ns) for one in stored] == [
        ('/a', 'std_msgs/msg/String', 30),
        ('/late', 'std_msgs/msg/String', 32),
    ]


@pytest.mark.parametrize('count', [1, 3, 4])
def test_last_chunk_with_a_wrong_checksum_is_none(whole, left, count):
    found = scan(left(whole))
    inside = found.chunks[count - 1].index.chunk_start_offset + 90
    data = bytearray(whole[: found.chunks[count - 1].end])
    data[inside] ^= 0xFF
    assert len(scan(left(bytes(data))).chunks) == count - 1


def test_damaged_chunk_is_told_when_it_is_read(whole, left):
    found = scan(left(whole))
    data = bytearray(whole)
    data[found.chunks[1].index.chunk_start_offset + 90] ^= 0xFF
    path = left(bytes(data))
    found = scan(path)
    with pytest.raises(BagError, match=r'chunk at byte \d+ is damaged'):
        list(messages(path, found.chunks[1], found.contents(FRAMES)))


def test_notes_stand_before_the_data(whole, left):
    assert scan(left(whole)).metadata['rsmb']['note'] == 'kept'


def test_summary_says_what_the_library_counts(whole):
    reader = make_reader(BytesIO(whole), validate_crcs=True)
    statistics = reader.get_summary().statistics
    found = [(channel.topic, message.log_time) for _, channel, message in reader.iter_messages()]
    assert (statistics.message_count, statistics.chunk_count) == (len(found), FRAMES)
    assert (statistics.message_start_time, statistics.message_end_time) == (0, 42)
    counts = {reader.get_summary().channels[n].topic: count
              for n, count in statistics.channel_message_counts.items()}  # fmt: skip
    assert counts == {'/a': 5, '/b': 4, '/late': 3}


def test_file_of_another_kind_is_refused(left):
    with pytest.raises(BagError, match=r'no \.mcap file'):
        scan(left(b'SQLite format 3\0' * 4))


def test_recording_of_another_program_is_refused(left):
    from mcap.writer import CompressionType, Writer

    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.LZ4)
    writer.start()
    channel = writer.register_channel('/a', 'json', 0)
    writer.add_message(channel, 0, b'{}', 0)
    writer.finish()
    with pytest.raises(BagError, match="was not written by rsmb, or is damaged: compression 'lz4'"):
        scan(left(stream.getvalue()))


def test_full_disk_is_told_and_leaves_what_was_written(tmp_path, factory, monkeypatch):
    path = tmp_path / 'full.mcap'
    writer = BagWriter(path, chunk_bytes=None)
    write_frame(writer, factory, 0)
    monkeypatch.setattr(writer._file, '_stream', _Full(writer._stream))
    with pytest.raises(BagError, match=r'full\.mcap: cannot be written: No space left'):
        write_frame(writer, factory, 1)
    writer.close()
    assert not path.exists()
    assert len(scan(tmp_path / 'full.mcap.part').chunks) == 1


class _Full:
    """A stream on a disk that holds ten more bytes."""

    def __init__(self, stream):
        self._stream = stream

    def tell(self):
        return self._stream.tell()

    def write(self, data):
        self._stream.write(data[:10])
        raise OSError(28, 'No space left on device')
