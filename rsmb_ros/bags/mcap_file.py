"""
One .mcap as a sequence of whole chunks, which can be cut after any of them and gone on with.

The library's writer cannot be told where a chunk ends in all its versions, nor go on with a file
that is there; its records, and so its idea of the format, are used here all the same.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b'\x89MCAP0\r\n'
COMPRESSION = 'zstd'
_LEVEL = 1  # level 3 takes twice the time for 1 % of images with noise


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
    Writes records; what is pending reaches the stream as one chunk, in one call.

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
        self._messages = RecordBuilder()
        self._index: dict[int, list[tuple[int, int]]] = {}  # channel -> time, place in the chunk
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)

    @property
    def pending(self) -> int:
        """Bytes of the chunk that is not written yet."""
        return self._messages.count

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
        self._index.setdefault(channel, []).append((time_ns, self._messages.count))
        Message(
            channel_id=channel,
            log_time=time_ns,
            publish_time=time_ns,
            sequence=self.contents.counts[channel],
            data=data,
        ).write(self._messages)
        self.contents.counts[channel] += 1

    def flush(self) -> None:
        """Write what is pending as one chunk and hand it to the operating system."""
        if not self._index:
            return
        definitions, messages = self._definitions.end(), self._messages.end()
        data = definitions + messages
        times = [time_ns for entries in self._index.values() for time_ns, _ in entries]
        chunk = Chunk(
            compression=COMPRESSION,
            data=self._compressor.compress(data),
            message_start_time=min(times),
            message_end_time=max(times),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        builder = RecordBuilder()
        chunk.write(builder)
        start, length = self._stream.tell(), builder.count
        offsets = {}
        for channel, entries in self._index.items():
            offsets[channel] = start + builder.count
            places = [(time_ns, place + len(definitions)) for time_ns, place in entries]
            MessageIndex(channel_id=channel, records=places).write(builder)
        self.contents.chunks.append(
            chunk_index(chunk, start, length, offsets, builder.count - length)
        )
        self._index.clear()
        self._stream.write(builder.end())
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


def chunk_index(
    chunk: Chunk, start: int, length: int, offsets: dict[int, int], index_length: int
) -> ChunkIndex:
    """Return the summary's entry of a chunk that begins at byte `start` of the file."""
    return ChunkIndex(
        message_start_time=chunk.message_start_time,
        message_end_time=chunk.message_end_time,
        chunk_start_offset=start,
        chunk_length=length,
        message_index_offsets=offsets,
        message_index_length=index_length,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        uncompressed_size=chunk.uncompressed_size,
    )
