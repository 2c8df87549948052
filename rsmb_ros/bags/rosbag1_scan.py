"""ROS 1 bags without an index, as a recorder leaves them that was killed: read from the front."""

from __future__ import annotations

import bz2
import mmap
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import lz4.frame
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    MessageDefinition,
    MessageDefinitionFormat,
    TopicInfo,
)
from rosbags.typesys.msg import normalize_msgtype

from .damage import Damage, Unreadable
from .merging import Entry, by_time

MAGIC = b'#ROSBAG V2.0\n'
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # operations of records
_BROKEN = (Unreadable, struct.error, KeyError, IndexError, ValueError)
_DECOMPRESSORS: dict[bytes, Callable[[], Callable[[bytes], bytes]]] = {
    b'none': lambda: bytes,
    b'bz2': lambda: bz2.BZ2Decompressor().decompress,
    b'lz4': lambda: lz4.frame.LZ4FrameDecompressor().decompress,
}


class _Record(NamedTuple):
    fields: dict[bytes, bytes]
    body: memoryview  # as much of it as there is
    end: int  # where the next record starts; may be behind the end of what there is

    @property
    def operation(self) -> int:
        return self.fields[b'op'][0]


class Rosbag1Scan:
    """
    One ROS 1 bag as `rosbags` reads bags; its whole chunks, and the whole messages of the last.

    Parameters
    ----------
    path : Path
    damage : Damage
        Is told what cannot be read.

    """

    def __init__(self, path: Path, damage: Damage) -> None:
        self.path = path
        self.connections: list[Connection] = []
        self._damage = damage
        self._data = memoryview(b'')
        self._chunks: list[tuple[int, int]] = []  # time of the first message [ns], offset
        self.start_time, self.end_time = 1 << 63, 0  # log times of the first and last message [ns]

    def __enter__(self) -> Rosbag1Scan:
        self.open()
        return self

    def __exit__(self, *reason: object) -> None:
        self.close()

    def open(self) -> None:
        """
        Find out what is in the file.

        Raises
        ------
        Unreadable
            If it is no ROS 1 bag.

        """
        with self.path.open('rb') as stream:
            self._data = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
        if bytes(self._data[: len(MAGIC)]) != MAGIC:
            raise Unreadable('its first bytes are not those of a ROS 1 bag')
        counts: Counter[int] = Counter()
        found: dict[int, Connection] = {}
        at = len(MAGIC)
        try:
            while at < len(self._data):
                record = _record(self._data, at)
                if record.operation == _CHUNK:
                    self._survey(at, found, counts)
                elif record.operation == _CONNECTION:
                    self._define(record, found)
                at = record.end
        except _BROKEN as error:
            self._damage.note(
                (str(self.path), at), f'{self.path}: read up to byte {at}: {_reason(error)}'
            )
        self.connections = [
            one._replace(msgcount=counts[one.id]) for one in found.values() if counts[one.id]
        ]

    def close(self) -> None:
        """Let go of the file."""
        self._data = memoryview(b'')

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Connections by topic."""
        found = {}
        for name, group in groupby(
            sorted(self.connections, key=lambda one: one.topic), key=lambda one: one.topic
        ):
            members = list(group)
            kinds = {one.msgtype for one in members}
            kind = kinds.pop() if len(kinds) == 1 else None
            count = sum(one.msgcount for one in members)
            found[name] = TopicInfo(kind, members[0].msgdef, count, members)
        return found

    def messages(
        self,
        connections: Collection[Connection] = (),
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Iterate over connection, log time [ns] and data of the messages, by log time."""
        wanted = {one.id: one for one in connections or self.connections}
        for entry in by_time(self._chunks, self._of_chunk):
            early = start is not None and entry.time_ns < start
            late = stop is not None and entry.time_ns >= stop
            if entry.channel in wanted and not early and not late:
                yield wanted[entry.channel], entry.time_ns, bytes(entry.data)

    def _survey(self, at: int, found: dict[int, Connection], counts: Counter[int]) -> None:
        """Learn what is in a chunk."""
        first_ns = None
        for record, _ in self._records_of(at):
            if record.operation == _CONNECTION:
                self._define(record, found)
            elif record.operation == _MESSAGE:
                counts[_number(record)] += 1
                time_ns = _time_ns(record)
                first_ns = time_ns if first_ns is None else min(first_ns, time_ns)
                self.start_time = min(self.start_time, time_ns)
                self.end_time = max(self.end_time, time_ns)
        if first_ns is not None:
            self._chunks.append((first_ns, at))

    def _of_chunk(self, at: int) -> Iterator[Entry]:
        for record, place in self._records_of(at):
            if record.operation == _MESSAGE:
                yield Entry(_time_ns(record), at, place, _number(record), record.body)

    def _records_of(self, at: int) -> Iterator[tuple[_Record, int]]:
        """Iterate over the whole records in a chunk and their places; a damaged one ends it."""
        chunk = _record(self._data, at)
        compression, (size,) = chunk.fields[b'compression'], _u32(chunk.fields[b'size'])
        if compression not in _DECOMPRESSORS:
            raise Unreadable(f'compression {compression!r} is none of bz2, lz4, none')
        raw, problem = b'', ''
        decompress = _DECOMPRESSORS[compression]()
        try:
            for first in range(0, len(chunk.body), 1 << 16):
                raw += decompress(bytes(chunk.body[first : first + (1 << 16)]))
        except (OSError, RuntimeError, EOFError, ValueError) as error:
            problem = str(error)
        if len(raw) != size:
            text = f'{self.path}: chunk at byte {at} is damaged or cut off: {len(raw)} of {size} '
            self._damage.note((str(self.path), at), f'{text}bytes can be read {problem}'.strip())
        data, place = memoryview(raw), 0
        try:
            while place < len(data):
                record = _record(data, place)
                if record.end > len(data):
                    return
                yield record, place
                place = record.end
        except _BROKEN as error:
            self._damage.note(
                (str(self.path), at, place),
                f'{self.path}: chunk at byte {at} read in part: {_reason(error)}',
            )

    def _define(self, record: _Record, found: dict[int, Connection]) -> None:
        number = _number(record)
        if number in found:
            return
        told = _fields(record.body)
        definition = MessageDefinition(
            MessageDefinitionFormat.MSG, told[b'message_definition'].decode()
        )
        found[number] = Connection(
            number,
            '/' + record.fields[b'topic'].decode().lstrip('/'),
            normalize_msgtype(told[b'type'].decode()),
            definition,
            told[b'md5sum'].decode(),
            0,
            ConnectionExtRosbag1(None, None),
            self,
        )


def _record(data: memoryview, at: int) -> _Record:
    (length,) = struct.unpack_from('<I', data, at)
    first = at + 4
    (size,) = struct.unpack_from('<I', data, first + length)
    body = first + length + 4
    return _Record(_fields(data[first : first + length]), data[body : body + size], body + size)


def _fields(data: memoryview) -> dict[bytes, bytes]:
    """Return the ``name=value`` fields of a header."""
    fields, at = {}, 0
    while at < len(data):
        (length,) = struct.unpack_from('<I', data, at)
        name, equals, value = bytes(data[at + 4 : at + 4 + length]).partition(b'=')
        if not equals or at + 4 + length > len(data):
            raise Unreadable('a header is damaged')
        fields[name] = value
        at += 4 + length
    return fields


def _u32(value: bytes) -> tuple[int]:
    return struct.unpack('<I', value)


def _number(record: _Record) -> int:
    return _u32(record.fields[b'conn'])[0]


def _time_ns(record: _Record) -> int:
    seconds, nanoseconds = struct.unpack('<II', record.fields[b'time'])
    return seconds * 10**9 + nanoseconds


def _reason(error: Exception) -> str:
    return f'{error or type(error).__name__}'
