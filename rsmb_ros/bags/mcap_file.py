"""
One .mcap as a sequence of whole chunks, which can be cut after any of them and gone on with.

The library's writer cannot be told where a chunk ends in all its versions, nor go on with a file
that is there; its records, and so its idea of the format, are used here all the same.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from .mcap_records import MAGIC

COMPRESSION = 'zstd'
_LEVEL = 1  # level 3 takes 3 times as long; images with noise get 0 to 11 % smaller
_MESSAGE = struct.Struct('<BQHIQQ')  # opcode, length, channel, sequence, log and publish time
_CHUNK = struct.Struct('<BQQQQI')  # opcode, length, first time, last time, bytes, crc
_HEAD_BYTES = 9  # opcode and length


@dataclass
class Contents:
    """What a file holds so far: all that its summary will say."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)  # channel -> messages
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)

    @property
    def statistics(self) -> Statistics:
        """Return the record with the numbers."""
        filled = [chunk for chunk in self.chunks if chunk.message_index_offsets]
        return Statistics(
            message_count=sum(self.counts.values()),
            schema_count=len(self.schemas),
            channel_count=len(self.channels),
            attachment_count=0,
            metadata_count=len(self.metadata),
            chunk_count=len(self.chunks),
            message_start_time=min((chunk.message_start_time for chunk in filled), default=0),
            message_end_time=max((chunk.message_end_time for chunk in filled), default=0),
            channel_message_counts=dict(self.counts),
        )


class McapFile:
    """
    Writes records; what is pending reaches the stream as one chunk.

    Parameters
    ----------
    stream : binary file, open for writing
        At its end if `contents` are given, else empty.
    contents : Contents, optional
        What is in the file already, see `scan`.

    """

    def __init__(self, stream: IO[bytes], contents: Contents | None = None) -> None:
        self._stream = stream
        self.contents = contents or Contents()
        self._definitions = RecordBuilder()  # stand before the messages of their chunk
        self._messages: list[bytes] = []  # records in pieces: joined, and so copied, only once
        self._size = 0  # of the messages [bytes]
        self._index: dict[int, list[tuple[int, int]]] = {}  # channel -> time, place among them
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)

    @property
    def pending(self) -> int:
        """Bytes of the chunk that is not written yet."""
        return self._size

    def start(self, profile: str, library: str) -> None:
        """Write what a file begins with."""
        builder = RecordBuilder()
        Header(profile, library).write(builder)
        self._stream.write(MAGIC + builder.end())

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record at once."""
        builder = RecordBuilder()
        Metadata(name=name, metadata=values).write(builder)
        record = builder.end()
        index = MetadataIndex(offset=self._stream.tell(), length=len(record), name=name)
        self.contents.metadata.append(index)
        self._stream.write(record)

    def add_schema(self, name: str, encoding: str, text: bytes) -> int:
        """Return the id of a new schema."""
        schema = Schema(id=len(self.contents.schemas) + 1, name=name, encoding=encoding, data=text)
        self.contents.schemas[schema.id] = schema
        schema.write(self._definitions)
        return schema.id

    def add_channel(self, topic: str, encoding: str, schema: int, values: dict[str, str]) -> int:
        """Return the id of a new channel."""
        channel = Channel(
            id=len(self.contents.channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=values,
            schema_id=schema,
        )
        self.contents.channels[channel.id] = channel
        self.contents.counts[channel.id] = 0
        channel.write(self._definitions)
        return channel.id

    def add_message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add a message to the chunk."""
        self._index.setdefault(channel, []).append((time_ns, self._size))
        length = _MESSAGE.size - _HEAD_BYTES + len(data)
        number = self.contents.counts[channel]
        head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, number, time_ns, time_ns)
        self._messages += (head, data)
        self._size += len(head) + len(data)
        self.contents.counts[channel] += 1

    def flush(self) -> None:
        """Write what is pending as one chunk and hand it to the operating system."""
        if not self._index:
            return
        definitions = self._definitions.end()
        data = b''.join([definitions, *self._messages])
        times = [time_ns for entries in self._index.values() for time_ns, _ in entries]
        stored = self._compressor.compress(data)
        name = _string(COMPRESSION)
        length = _CHUNK.size + len(name) + 8 + len(stored)
        first, last = min(times), max(times)
        head = _CHUNK.pack(
            Opcode.CHUNK, length - _HEAD_BYTES, first, last, len(data), zlib.crc32(data)
        )
        start = self._stream.tell()
        offsets, builder = {}, RecordBuilder()
        for channel, entries in self._index.items():
            offsets[channel] = start + length + builder.count
            places = [(time_ns, place + len(definitions)) for time_ns, place in entries]
            MessageIndex(channel_id=channel, records=places).write(builder)
        index = ChunkIndex(
            message_start_time=first,
            message_end_time=last,
            chunk_start_offset=start,
            chunk_length=length,
            message_index_offsets=offsets,
            message_index_length=builder.count,
            compression=COMPRESSION,
            compressed_size=len(stored),
            uncompressed_size=len(data),
        )
        self.contents.chunks.append(index)
        self._messages, self._size = [], 0
        self._index.clear()
        for part in (head, name, struct.pack('<Q', len(stored)), stored, builder.end()):
            self._stream.write(part)
        self._stream.flush()

    def finish(self) -> None:
        """Write what is pending, the summary and the end."""
        self.flush()
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        self._stream.write(builder.end())
        start = self._stream.tell()
        offsets = self._write_summary(builder, start)
        offset_start = start + builder.count
        for offset in offsets:
            offset.write(builder)
        summary = builder.end()
        Footer(start, offset_start, 0).write(builder)
        head = builder.end()[:-4]  # the sum covers the footer up to itself
        crc = zlib.crc32(head, zlib.crc32(summary))
        Footer(start, offset_start, crc).write(builder)
        self._stream.write(summary + builder.end() + MAGIC)
        self._stream.flush()

    def _write_summary(self, builder: RecordBuilder, start: int) -> list[SummaryOffset]:
        """Write the groups of the summary and return where each lies."""
        held = self.contents
        groups = (
            (Opcode.SCHEMA, list(held.schemas.values())),
            (Opcode.CHANNEL, list(held.channels.values())),
            (Opcode.STATISTICS, [held.statistics]),
            (Opcode.CHUNK_INDEX, held.chunks),
            (Opcode.METADATA_INDEX, held.metadata),
        )
        offsets = []
        for opcode, records in groups:
            begin = builder.count
            for record in records:
                record.write(builder)
            if records:
                offsets.append(SummaryOffset(opcode, start + begin, builder.count - begin))
        return offsets


def _string(text: str) -> bytes:
    data = text.encode()
    return struct.pack('<I', len(data)) + data
