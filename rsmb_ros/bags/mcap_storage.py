"""Messages of an .mcap file whose every chunk is checked; damaged ones are skipped and told."""

from __future__ import annotations

import mmap
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import ReaderMetadata

from .damage import Damage, Unreadable
from .mcap_index import Contents, contents_of
from .mcap_records import BROKEN, MESSAGE, RECORD, Chunk, beginning, content, records
from .merging import Entry, by_time

_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
    '': MessageDefinitionFormat.NONE,
}
_CDR = 'cdr'


class McapStorage:
    """
    One .mcap as `rosbags` reads storages.

    Parameters
    ----------
    path : Path
    damage : Damage
        Is told what cannot be read.

    """

    def __init__(self, path: Path, damage: Damage) -> None:
        self.path = path
        self.connections: list[Connection] = []
        self.metadata = ReaderMetadata(0, 2**63 - 1, 0, 0, None, None, None, None)
        self._damage = damage
        self._name = str(path)
        self._map: mmap.mmap | None = None
        self._data = memoryview(b'')
        self._contents = Contents()

    def open(self) -> None:
        """
        Find out what is in the file.

        Raises
        ------
        Unreadable
            If it is no .mcap of ROS 2.

        """
        with self.path.open('rb') as stream:
            if not stream.read(1):
                raise Unreadable('the file is empty')
            self._map = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self._data = memoryview(self._map)
        try:
            self._contents = contents_of(self._data, self._name, self._damage)
            self.connections = self._readable()
        except BaseException:
            self.close()
            raise
        without = sum(not chunk.crc for chunk in self._contents.chunks)
        if without or self._contents.loose:
            self._damage.unchecked.append(
                f'{self._name}: {without} chunks and {len(self._contents.loose)} messages outside '
                'chunks have no CRC; damage in them cannot be told'
            )
        count = sum(self._contents.counts.values())
        first, last = self._contents.span_ns
        self.metadata = self.metadata._replace(message_count=count, start_time=first, end_time=last)

    def close(self) -> None:
        """Close the file."""
        self._data.release()
        if self._map is not None:
            with suppress(BufferError):  # an iteration that was left holds a part; it goes with it
                self._map.close()
            self._map = None

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Iterate over connection, log time [ns] and data of the messages, by log time."""
        wanted = {connection.id: connection for connection in connections}
        first, last = start or 0, 2**64 if stop is None else stop
        latest = 0
        for entry in self._entries(wanted):
            if entry.time_ns < latest:
                text = f'{self._name}: its index is damaged: messages come in a wrong order'
                self._damage.note((self._name, 'order'), text)
            latest = max(latest, entry.time_ns)
            if first <= entry.time_ns < last:
                yield wanted[entry.channel], entry.time_ns, bytes(entry.data)

    def _entries(self, wanted: Collection[int]) -> Iterator[Entry]:
        """Iterate over the messages by log time; equal times in the order of the file."""
        chunks = [*self._contents.chunks]
        if self._contents.cut_off is not None:
            chunks.append(self._contents.cut_off)
        starts = [
            (chunk.start_ns, number)
            for number, chunk in enumerate(chunks)
            if chunk.counts is None or any(map(chunk.counts.get, wanted))
        ]
        loose = self._loose(wanted)
        if loose:
            starts.append((loose[0].time_ns, -1))

        def load(number: int) -> list[Entry]:
            return loose if number < 0 else self._of_chunk(number, chunks[number], wanted)

        return by_time(starts, load)

    def _of_chunk(self, number: int, chunk: Chunk, wanted: Collection[int]) -> list[Entry]:
        entries = []
        try:
            partly = chunk is self._contents.cut_off
            raw = (beginning if partly else content)(self._data, chunk)
            for opcode, record, at in records(raw):
                if opcode == Opcode.MESSAGE:
                    channel, _, time_ns, _ = MESSAGE.unpack_from(record)
                    if channel in wanted:
                        data = record[MESSAGE.size :]
                        entries.append(Entry(time_ns, number, at, channel, data))
        except BROKEN as error:
            self._tell(chunk, error)
        return entries

    def _loose(self, wanted: Collection[int]) -> list[Entry]:
        """Return the messages outside chunks by time; their data stays in the file."""
        entries = []
        for time_ns, channel, at in self._contents.loose:
            if channel in wanted:
                _, length = RECORD.unpack_from(self._data, at)
                first = at + RECORD.size
                data = self._data[first + MESSAGE.size : first + length]
                entries.append(Entry(time_ns, -1, at, channel, data))
        return sorted(entries)

    def _tell(self, chunk: Chunk, error: BaseException) -> None:
        names = {connection.id: connection.topic for connection in self.connections}
        counts = chunk.counts or {}
        lost = ', '.join(f'{n} of {names.get(c, "?")}' for c, n in sorted(counts.items()) if n)
        self._damage.note(
            (self._name, chunk.offset),
            f'{self._name}: chunk at byte {chunk.offset} is damaged: {error}; its messages are '
            f'skipped: {lost or "how many is not known"}; copy the file again if you can',
            sum(counts.values()),
        )

    def _readable(self) -> list[Connection]:
        """Return the channels that hold messages of ROS 2."""
        channels = self._contents.channels.values()
        found = [self._connection(channel) for channel in channels]
        if channels and not any(found):
            encodings = ', '.join(sorted({channel.message_encoding for channel in channels}))
            raise Unreadable(f'its messages are {encodings}, must be {_CDR} (ROS 2)')
        unknown = set(self._contents.counts) - set(self._contents.channels)
        if unknown:
            lost = sum(self._contents.counts[channel] for channel in unknown)
            self._damage.note(
                (self._name, 'channels'),
                f'{self._name}: {lost} messages are of channels whose names are lost; skipped',
                lost,
            )
        return [connection for connection in found if connection is not None]

    def _connection(self, channel: Channel) -> Connection | None:
        schema = self._contents.schemas.get(channel.schema_id)
        encoding = schema.encoding if schema else ''
        if channel.message_encoding != _CDR or encoding not in _FORMATS:
            return None
        text = schema.data.decode() if schema else ''
        return Connection(
            channel.id,
            channel.topic,
            schema.name if schema else '__schemaless__',
            MessageDefinition(_FORMATS[encoding], text),
            '',
            self._contents.counts[channel.id],
            ConnectionExtRosbag2(_CDR, []),
            self,
        )
