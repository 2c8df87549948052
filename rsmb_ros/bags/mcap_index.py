"""What is where in an .mcap file: told by its summary, or found by walking through the file."""

from __future__ import annotations

import re
import struct
from collections import Counter
from dataclasses import dataclass, field
from zlib import crc32

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, Schema, Statistics

from .damage import Damage, Unreadable
from .mcap_records import (
    BROKEN,
    MAGIC,
    MESSAGE,
    RECORD,
    Chunk,
    beginning,
    chunk_at,
    content,
    records,
    stream_of,
)

FOOTER = struct.Struct('<BQQQI')  # opcode, length, start of the summary, of its offsets, CRC
_CHUNK_HEADER = re.compile(
    rb'\x06.{8}.{28}(?:\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4|\x00\x00\x00\x00).{8}', re.DOTALL
)
# Records besides chunks and messages that stand before the summary.
_BEFORE_THE_END = (
    *(Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE_INDEX),
    *(Opcode.ATTACHMENT, Opcode.METADATA),
)


@dataclass
class Contents:
    """What is in a file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    cut_off: Chunk | None = None  # the last one, where the file ends within
    loose: list[tuple[int, int, int]] = field(default_factory=list)  # time, channel, offset
    counts: Counter[int] = field(default_factory=Counter)  # channel -> messages
    span_ns: tuple[int, int] = (1 << 63, 0)  # log times of the first and the last message

    def take(self, raw: memoryview) -> int:
        """Learn from the records of a chunk; returns the least log time in it [ns]."""
        start_ns = 1 << 63
        for opcode, record, _ in records(raw):
            if opcode == Opcode.MESSAGE:
                channel, _, time_ns, _ = MESSAGE.unpack_from(record)
                self.count(channel, time_ns)
                start_ns = min(start_ns, time_ns)
            else:
                self.define(opcode, record)
        return start_ns

    def count(self, channel: int, time_ns: int) -> None:
        """Count a message."""
        self.counts[channel] += 1
        self.span_ns = min(self.span_ns[0], time_ns), max(self.span_ns[1], time_ns)

    def define(self, opcode: int, record: memoryview) -> None:
        """Learn a schema or a channel; the first one of an id counts."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream_of(record))
            self.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream_of(record))
            self.channels.setdefault(channel.id, channel)


def contents_of(data: memoryview, name: str, damage: Damage) -> Contents:
    """
    Return what is in a file.

    Parameters
    ----------
    data : memoryview
        The whole file.
    name : str
        For messages.
    damage : Damage
        Is told what of the file is missing or wrong.

    Raises
    ------
    Unreadable
        If it is no .mcap.

    """
    begins = bytes(data[: len(MAGIC)]) == MAGIC
    ends = bytes(data[-len(MAGIC) :]) == MAGIC
    if not begins and not ends:
        raise Unreadable('neither its first nor its last bytes are those of an .mcap')
    try:
        if not begins or not ends:
            raise Unreadable('the file is cut off' if begins else 'its first bytes are damaged')
        found = _from_summary(data)
        if found is not None:
            return found
    except BROKEN as error:
        damage.note((name, 'index'), _without_index(name, error))
    found = Contents()
    _Walk(data, name, damage, found).run()
    return found


def _without_index(name: str, error: BaseException) -> str:
    return f'{name}: no index: {error or type(error).__name__}; the file is walked through'


def _from_summary(data: memoryview) -> Contents | None:
    """Return what the summary tells, None where there is none or it has no index of messages."""
    at = len(data) - len(MAGIC) - FOOTER.size
    opcode, length, start, _, crc = FOOTER.unpack_from(data, at)
    if opcode != Opcode.FOOTER or length != FOOTER.size - RECORD.size or not 0 <= start <= at:
        raise Unreadable('its footer is damaged')
    if not start:
        return None
    if crc and crc32(data[start : at + FOOTER.size - 4]) != crc:
        raise Unreadable('the CRC of its summary is wrong')
    found, statistics, listed = Contents(), None, 0
    for opcode, record, _ in records(data[start:at]):
        if opcode == Opcode.STATISTICS:
            statistics = Statistics.read(stream_of(record))
        elif opcode == Opcode.CHUNK_INDEX:
            chunk = _indexed(data, ChunkIndex.read(stream_of(record)))
            # counts that nothing checks must not make anyone pass over a chunk
            found.chunks.append(chunk if crc else chunk._replace(counts=None))
            listed += 1
        else:
            found.define(opcode, record)
    if statistics is None or not found.channels or statistics.chunk_count != listed:
        return None
    found.counts.update(statistics.channel_message_counts)
    found.span_ns = statistics.message_start_time, statistics.message_end_time
    return found if listed or not statistics.message_count else None


def _indexed(data: memoryview, index: ChunkIndex) -> Chunk:
    """Return a chunk as the index knows it; only its CRC stands at the chunk alone."""
    offset = index.chunk_start_offset
    crc_at = offset + RECORD.size + 24
    (crc,) = struct.unpack_from('<I', data, crc_at)
    data_at = crc_at + 4 + 4 + len(index.compression) + 8
    return Chunk(
        offset,
        index.message_start_time,
        data_at,
        index.compressed_size,
        index.uncompressed_size,
        crc,
        index.compression,
        _counts(index),
    )


def _counts(index: ChunkIndex) -> dict[int, int] | None:
    """Return the messages of each channel in a chunk, by the lengths of its message indexes."""
    if not index.message_index_offsets:
        return None
    starts = sorted((at, channel) for channel, at in index.message_index_offsets.items())
    end = index.chunk_start_offset + index.chunk_length + index.message_index_length
    ends = [*(at for at, _ in starts[1:]), end]
    # a record of 9 bytes, 2 + 4 of its own, 16 a message
    return {
        channel: (stop - at - 15) // 16 for (at, channel), stop in zip(starts, ends, strict=True)
    }


class _Walk:
    """One walk through a file; where the records do not join, on to the next chunk."""

    def __init__(self, data: memoryview, name: str, damage: Damage, found: Contents) -> None:
        self._data, self._name, self._damage, self._found = data, name, damage, found

    def run(self) -> None:
        """Walk from the first record to the end of the data."""
        at = len(MAGIC)
        while at + RECORD.size <= len(self._data):
            opcode, length = RECORD.unpack_from(self._data, at)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER) and length < 64:
                self._check_all(at)
                return
            try:
                at = self._record(at, opcode, length)
            except BROKEN as error:
                self._skip(at, error)
                at = self._next_chunk(at + 1)

    def _record(self, at: int, opcode: int, length: int) -> int:
        """Take the record at `at`; returns where the next one is."""
        if opcode == Opcode.CHUNK:
            return self._chunk(at)
        end = at + RECORD.size + length
        if end > len(self._data):
            raise Unreadable('it does not end within the file')
        record = self._data[at + RECORD.size : end]
        if opcode == Opcode.MESSAGE:
            channel, _, time_ns, _ = MESSAGE.unpack_from(record)
            self._found.loose.append((time_ns, channel, at))
            self._found.count(channel, time_ns)
        elif opcode not in _BEFORE_THE_END or (opcode == Opcode.MESSAGE_INDEX and length % 16 != 6):
            raise Unreadable(f'no record there starts with {opcode}')
        else:
            self._found.define(opcode, record)
        return end

    def _chunk(self, at: int) -> int:
        chunk = chunk_at(self._data, at)
        if chunk.end > len(self._data):
            counts = self._found.counts.copy()
            start_ns = self._found.take(beginning(self._data, chunk))
            self._found.cut_off = chunk._replace(start_ns=start_ns)
            rescued = sum(self._found.counts.values()) - sum(counts.values())
            self._damage.note(
                (self._name, at),
                f'{self._name}: the file ends within the {_where(at)}; its first {rescued} '
                'messages are whole, no CRC can check them',
            )
            return len(self._data)
        try:
            raw = content(self._data, chunk)
        except Unreadable as error:
            self._skip(at, error)
            return chunk.end
        self._found.chunks.append(chunk._replace(start_ns=self._found.take(raw)))
        return chunk.end

    def _skip(self, at: int, error: BaseException) -> None:
        text = f'{self._name}: {_where(at)} is damaged: {error}; skipped'
        self._damage.note((self._name, at), text)

    def _next_chunk(self, first: int) -> int:
        """Return where the next header of a chunk is whose lengths agree, else the end."""
        for match in _CHUNK_HEADER.finditer(self._data, first):
            try:
                chunk_at(self._data, match.start())
            except BROKEN:
                continue
            return match.start()
        return len(self._data)

    def _check_all(self, at: int) -> None:
        """Check the CRC of all data, which is the only one where there are no chunks."""
        if not self._found.loose or self._data[at] != Opcode.DATA_END:
            return
        crc = DataEnd.read(stream_of(self._data[at + RECORD.size : at + RECORD.size + 4]))
        if crc.data_section_crc and crc32(self._data[:at]) != crc.data_section_crc:
            self._damage.note(
                (self._name, 'data'),
                f'{self._name}: the CRC of its data is wrong: at least one message is damaged, '
                'which one cannot be told; what follows may be wrong',
            )


def _where(at: int) -> str:
    return f'chunk or record at byte {at}'
