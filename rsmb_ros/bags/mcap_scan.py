"""What an .mcap of ours holds whose end is missing: its whole chunks, found without its summary."""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
)

from rsmb_ros.core.errors import BagError

from .mcap_file import COMPRESSION, MAGIC, Contents, chunk_index

_HEAD = struct.Struct('<BQ')  # opcode, length of what follows
_CHUNK = struct.Struct('<QQQI')  # first time, last time, bytes, crc


@dataclass
class WholeChunk:
    """One chunk with its index, and what is new in it."""

    index: ChunkIndex
    end: int  # first byte after its index
    counts: dict[int, int]  # channel -> messages
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
    metadata_index: list[MetadataIndex]
    metadata: dict[str, dict[str, str]]  # by the name of the record
    chunks: list[WholeChunk]

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


def scan(stream: IO[bytes]) -> Scan | None:
    """
    Return what a file that `McapFile` wrote holds; None if it is too short to hold anything.

    Parameters
    ----------
    stream : binary file, open for reading

    Raises
    ------
    BagError
        If it was written by another program.

    """
    stream.seek(0)
    magic = stream.read(len(MAGIC))
    if len(magic) == len(MAGIC) and magic != MAGIC:
        raise BagError(f'{stream.name}: no .mcap file')
    found = Scan(len(MAGIC), [], {}, [])
    known: set[int] = set()
    seen_header = False
    for opcode, start, length in _records(stream):
        if opcode == Opcode.HEADER:
            seen_header, found.start = True, start + _HEAD.size + length
        elif opcode == Opcode.METADATA and not found.chunks:
            record = Metadata.read(_body(stream, length))
            found.metadata[record.name] = record.metadata
            size = _HEAD.size + length
            found.metadata_index.append(MetadataIndex(start, size, record.name))
            found.start = start + size
        elif opcode == Opcode.CHUNK:
            index = _chunk_head(stream, start, length)
            found.chunks.append(WholeChunk(index, start + _HEAD.size + length, {}))
        elif opcode == Opcode.MESSAGE_INDEX and found.chunks:
            _take_index(stream, found.chunks[-1], start, length)
            _define(stream, found.chunks[-1], known)
        else:
            raise BagError(f'{stream.name}: was not written by rsmb: record of kind {opcode}')
    if found.chunks and not _is_whole(stream, found.chunks[-1]):
        found.chunks.pop()
    return found if seen_header else None


def _records(stream: IO[bytes]) -> Iterator[tuple[int, int, int]]:
    """Iterate over opcode, place and length of the whole records before the end of the data."""
    size = os.fstat(stream.fileno()).st_size
    start = len(MAGIC)
    while start + _HEAD.size <= size:
        stream.seek(start)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        if opcode == Opcode.DATA_END or start + _HEAD.size + length > size:
            return
        yield opcode, start, length
        start += _HEAD.size + length


def _body(stream: IO[bytes], length: int) -> ReadDataStream:
    return ReadDataStream(BytesIO(stream.read(length)))


def _chunk_head(stream: IO[bytes], start: int, length: int) -> ChunkIndex:
    """Read what comes before the data of a chunk."""
    first, last, size, crc = _CHUNK.unpack(stream.read(_CHUNK.size))
    (name_length,) = struct.unpack('<I', stream.read(4))
    compression = stream.read(min(name_length, 16)).decode(errors='replace')
    if compression != COMPRESSION:
        raise BagError(
            f'{stream.name}: was not written by rsmb: compression {compression!r}, '
            f'must be {COMPRESSION}'
        )
    chunk = Chunk(compression, b'', last, first, crc, size)
    index = chunk_index(chunk, start, _HEAD.size + length, {}, 0)
    (index.compressed_size,) = struct.unpack('<Q', stream.read(8))
    return index


def _take_index(stream: IO[bytes], chunk: WholeChunk, start: int, length: int) -> None:
    """Add one record of message indexes to its chunk."""
    record = MessageIndex.read(_body(stream, length))
    chunk.index.message_index_offsets[record.channel_id] = start
    chunk.end = start + _HEAD.size + length
    chunk.index.message_index_length = chunk.end - _chunk_end(chunk.index)
    chunk.counts[record.channel_id] = len(record.records)


def _chunk_end(index: ChunkIndex) -> int:
    return index.chunk_start_offset + index.chunk_length


def _define(stream: IO[bytes], chunk: WholeChunk, known: set[int]) -> None:
    """Read the definitions of a chunk that has channels which are not known yet."""
    if set(chunk.counts) <= known:
        return
    for opcode, body in _inner(_compressed(stream, chunk.index)):
        if opcode == Opcode.SCHEMA:
            chunk.schemas.append(Schema.read(ReadDataStream(BytesIO(body))))
        elif opcode == Opcode.CHANNEL:
            chunk.channels.append(Channel.read(ReadDataStream(BytesIO(body))))
        else:
            break
    known.update(channel.id for channel in chunk.channels)


def _compressed(stream: IO[bytes], index: ChunkIndex) -> IO[bytes]:
    """Return a reader of the data of a chunk."""
    stream.seek(_chunk_end(index) - index.compressed_size)
    source = BytesIO(stream.read(index.compressed_size))
    return zstandard.ZstdDecompressor().stream_reader(source)


def _inner(data: IO[bytes]) -> Iterator[tuple[int, bytes]]:
    """Iterate over opcode and content of the records in the data of a chunk."""
    while len(head := data.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        yield opcode, data.read(length)


def _is_whole(stream: IO[bytes], chunk: WholeChunk) -> bool:
    """Return whether the last chunk is all there: the last records of its index may be missing."""
    data = _checked(stream, chunk.index)
    if data is None:
        return False
    counts: Counter[int] = Counter()
    for opcode, body in _inner(BytesIO(data)):
        if opcode == Opcode.MESSAGE:
            counts[struct.unpack_from('<H', body)[0]] += 1
    return counts == chunk.counts


def _checked(stream: IO[bytes], index: ChunkIndex) -> bytes | None:
    """Return the data of a chunk, None if its checksum is wrong."""
    stream.seek(index.chunk_start_offset + _HEAD.size)
    crc = _CHUNK.unpack(stream.read(_CHUNK.size))[-1]
    stream.seek(_chunk_end(index) - index.compressed_size)
    try:
        data = zstandard.decompress(stream.read(index.compressed_size), index.uncompressed_size)
    except zstandard.ZstdError:
        return None
    return data if zlib.crc32(data) == crc else None


def messages(stream: IO[bytes], index: ChunkIndex, contents: Contents) -> Iterator[Stored]:
    """
    Iterate over the messages of one chunk.

    Raises
    ------
    BagError
        If its checksum is wrong.

    """
    data = _checked(stream, index)
    if data is None:
        raise BagError(
            f'{stream.name}: the chunk at byte {index.chunk_start_offset} is damaged; '
            'delete the file and start again'
        )
    for opcode, body in _inner(BytesIO(data)):
        if opcode == Opcode.MESSAGE:
            message = Message.read(ReadDataStream(BytesIO(body)), len(body))
            channel = contents.channels[message.channel_id]
            kind = contents.schemas[channel.schema_id].name
            yield Stored(channel.topic, kind, message.log_time, message.data)
