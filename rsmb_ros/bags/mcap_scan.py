"""What an .mcap of ours holds whose end is missing: its whole chunks, found without its summary."""

from __future__ import annotations

import mmap
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, MessageIndex, Metadata, MetadataIndex, Schema

from rsmb_ros.core.errors import BagError

from .damage import Unreadable
from .mcap_file import COMPRESSION, Contents
from .mcap_records import MAGIC, MESSAGE, RECORD, Chunk, chunk_at, content, records, stream_of

_LAST = struct.Struct('<Q')  # time of a chunk's last message, behind that of its first


@dataclass
class WholeChunk:
    """One chunk with its index, and what is new in it."""

    place: Chunk
    index: ChunkIndex  # its entry in a summary
    end: int  # first byte after its index
    counts: dict[int, int] = field(default_factory=dict)  # channel -> messages
    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)


class Stored(NamedTuple):
    """One message of a chunk."""

    topic: str
    type: str  # 'std_msgs/msg/String'
    time_ns: int
    data: bytes


@dataclass
class Scan:
    """Everything before the first byte that is missing."""

    start: int  # first byte of the first chunk
    metadata_index: list[MetadataIndex] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)  # by the record's name
    chunks: list[WholeChunk] = field(default_factory=list)

    def end(self, count: int) -> int:
        """Return the size of the file with its first `count` chunks [bytes]."""
        return self.chunks[count - 1].end if count else self.start

    def contents(self, count: int) -> Contents:
        """Return what the first `count` chunks hold."""
        held = Contents(metadata=list(self.metadata_index))
        counts: Counter[int] = Counter()
        for chunk in self.chunks[:count]:
            held.schemas.update({schema.id: schema for schema in chunk.schemas})
            held.channels.update({channel.id: channel for channel in chunk.channels})
            held.chunks.append(chunk.index)
            counts.update(chunk.counts)
        # in the order of the channels, as in a file that was never cut
        held.counts = {channel: counts[channel] for channel in held.channels}
        return held


def scan(path: Path) -> Scan | None:
    """
    Return what a file that `McapFile` wrote holds; None if it is too short to hold anything.

    Only the last chunk is decompressed, and those that define topics.

    Raises
    ------
    BagError
        If it was written by another program.

    """
    with _mapped(path) as data:
        if data[: len(MAGIC)] != MAGIC[: len(data)]:
            raise BagError(f'{path}: no .mcap file')
        try:
            return _scan(data)
        except (Unreadable, struct.error, UnicodeDecodeError, McapError) as error:
            reason = str(error) or 'a record is cut off'  # that of the library says nothing
            raise BagError(f'{path}: was not written by rsmb, or is damaged: {reason}') from error


def messages(path: Path, chunk: WholeChunk, contents: Contents) -> Iterator[Stored]:
    """
    Iterate over the messages of one chunk.

    Raises
    ------
    BagError
        If its checksum is wrong.

    """
    with _mapped(path) as data:
        try:
            raw = content(data, chunk.place)
        except Unreadable as error:
            raise BagError(
                f'{path}: the chunk at byte {chunk.place.offset} is damaged: {error}; '
                'delete the file and start again'
            ) from error
    for opcode, body, _ in records(raw):
        if opcode == Opcode.MESSAGE:
            number, _, time_ns, _ = MESSAGE.unpack_from(body)
            channel = contents.channels[number]
            kind = contents.schemas[channel.schema_id].name
            yield Stored(channel.topic, kind, time_ns, bytes(body[MESSAGE.size :]))


@contextmanager
def _mapped(path: Path) -> Iterator[memoryview]:
    with path.open('rb') as stream:
        if stream.read(1):
            # closed with the last slice of it
            yield memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
        else:
            yield memoryview(b'')


def _scan(data: memoryview) -> Scan | None:
    found = Scan(len(MAGIC))
    known: set[int] = set()
    seen_header = False
    for opcode, body, at in records(data[len(MAGIC) :]):
        start = len(MAGIC) + at
        end = start + RECORD.size + len(body)
        if opcode == Opcode.DATA_END:
            break
        if opcode == Opcode.HEADER:
            seen_header, found.start = True, end
        elif opcode == Opcode.METADATA and not found.chunks:
            record = Metadata.read(stream_of(body))
            found.metadata[record.name] = record.metadata
            found.metadata_index.append(MetadataIndex(start, end - start, record.name))
            found.start = end
        elif opcode == Opcode.CHUNK:
            found.chunks.append(_chunk(data, start))
        elif opcode == Opcode.MESSAGE_INDEX and found.chunks:
            chunk = found.chunks[-1]
            _take_index(chunk, body, start, end)
            if not set(chunk.counts) <= known:
                if not _define(chunk, data):
                    break  # what follows cannot be understood without
                known.update(channel.id for channel in chunk.channels)
        else:
            raise Unreadable(f'record of kind {opcode} at byte {start}')
    if found.chunks and not _is_whole(data, found.chunks[-1]):
        found.chunks.pop()
    return found if seen_header else None


def _chunk(data: memoryview, start: int) -> WholeChunk:
    place = chunk_at(data, start)
    if place.compression != COMPRESSION:
        raise Unreadable(f'compression {place.compression!r}, must be {COMPRESSION}')
    (last_ns,) = _LAST.unpack_from(data, start + RECORD.size + _LAST.size)
    index = ChunkIndex(
        message_start_time=place.start_ns,
        message_end_time=last_ns,
        chunk_start_offset=start,
        chunk_length=place.end - start,
        message_index_offsets={},
        message_index_length=0,
        compression=place.compression,
        compressed_size=place.data_size,
        uncompressed_size=place.size,
    )
    return WholeChunk(place, index, place.end)


def _take_index(chunk: WholeChunk, body: memoryview, start: int, end: int) -> None:
    """Add one record of message indexes to its chunk."""
    record = MessageIndex.read(stream_of(body))
    chunk.index.message_index_offsets[record.channel_id] = start
    chunk.index.message_index_length = end - chunk.place.end
    chunk.end = end
    chunk.counts[record.channel_id] = len(record.records)


def _define(chunk: WholeChunk, data: memoryview) -> bool:
    """Read the definitions in a chunk, which stand before its messages; False if it is damaged."""
    try:
        raw = content(data, chunk.place)
    except Unreadable:
        return False
    for opcode, body, _ in records(raw):
        if opcode == Opcode.SCHEMA:
            chunk.schemas.append(Schema.read(stream_of(body)))
        elif opcode == Opcode.CHANNEL:
            chunk.channels.append(Channel.read(stream_of(body)))
        else:
            break
    return True


def _is_whole(data: memoryview, chunk: WholeChunk) -> bool:
    """Return whether the last chunk is all there: the last records of its index may be missing."""
    try:
        raw = content(data, chunk.place)
    except Unreadable:
        return False
    counts: Counter[int] = Counter()
    for opcode, body, _ in records(raw):
        if opcode == Opcode.MESSAGE:
            counts[MESSAGE.unpack_from(body)[0]] += 1
    return counts == chunk.counts
