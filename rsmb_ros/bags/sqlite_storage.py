"""Messages of a .db3 file, row by row: what of a damaged one can be read is read."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import ReaderMetadata

from .damage import Damage, Unreadable

_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
_MAGIC = b'SQLite format 3\0'
_HEADER = 100  # bytes
_WIDEST_GAP = 1 << 24  # rows that are skipped at once behind a damaged page, at most


class SqliteStorage:
    """
    One .db3 as `rosbags` reads storages.

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
        self._rows: list[tuple[int, int, int]] = []  # log time, id, topic; by log time
        self._database: sqlite3.Connection | None = None
        self._copy: TemporaryDirectory[str] | None = None

    def open(self) -> None:
        """
        Find out what is in the file.

        Raises
        ------
        Unreadable
            If it is no .db3 of rosbag2, or so damaged that its topics cannot be read.

        """
        # a recorder that was killed has left rows in a log beside the file
        log = self.path.with_name(self.path.name + '-wal').exists()
        mode = 'mode=ro' if log else 'mode=ro&immutable=1'
        try:
            path = self._whole_pages()
            self._database = sqlite3.connect(f'file:{quote(str(path))}?{mode}', uri=True)
            self._database.text_factory = lambda text: text.decode('utf-8', 'replace')
            topics = self._topics()
        except sqlite3.Error as error:
            self.close()
            raise Unreadable(f'its topics cannot be read: {error}') from error
        self._rows = sorted(self._walk())
        counts: dict[int, int] = {}
        for _, _, topic in self._rows:
            counts[topic] = counts.get(topic, 0) + 1
        self.connections = [one._replace(msgcount=counts.get(one.id, 0)) for one in topics]
        if self._rows:
            first, last = self._rows[0][0], self._rows[-1][0]
            self.metadata = self.metadata._replace(
                message_count=len(self._rows), start_time=first, end_time=last
            )

    def _whole_pages(self) -> Path:
        """
        Return a file with the pages that are there, and no claim of more.

        Of a file that is cut off this is a copy: sqlite takes what is missing for zeros.
        """
        with self.path.open('rb') as stream:
            header = stream.read(_HEADER)
            size = os.fstat(stream.fileno()).st_size
        if len(header) < _HEADER or not header.startswith(_MAGIC):
            raise Unreadable('its first bytes are not those of a .db3')
        page = int.from_bytes(header[16:18], 'big')
        page = 65536 if page == 1 else page  # which has two bytes
        claimed = int.from_bytes(header[28:32], 'big')
        known = header[24:28] == header[92:96]  # else the number of pages is an old one
        if page < 512 or not known or size >= page * claimed:
            return self.path
        self._damage.note(
            (str(self.path), 'size'),
            f'{self.path}: the file is cut off, {size} of {page * claimed} bytes; the messages '
            'that are whole are read from a copy',
        )
        self._copy = TemporaryDirectory(prefix='rsmb-')
        copy = Path(self._copy.name) / self.path.name
        shutil.copyfile(self.path, copy)
        with copy.open('r+b') as stream:
            stream.truncate(size // page * page)
            stream.seek(28)
            stream.write((size // page).to_bytes(4, 'big'))
        return copy

    def close(self) -> None:
        """Close the file."""
        if self._copy is not None:
            self._copy.cleanup()
            self._copy = None
        if self._database is not None:
            self._database.close()
            self._database = None

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Iterate over connection, log time [ns] and data of the messages, by log time."""
        wanted = {connection.id: connection for connection in connections}
        for time_ns, row, topic in self._rows:
            early, late = (
                start is not None and time_ns < start,
                stop is not None and time_ns >= stop,
            )
            if topic not in wanted or early or late:
                continue
            data = self._data_of(row, wanted[topic].topic)
            if data is not None:
                yield wanted[topic], time_ns, data

    def _data_of(self, row: int, topic: str) -> bytes | None:
        assert self._database is not None
        try:
            found = self._database.execute('SELECT data FROM messages WHERE id = ?', (row,))
            (data,) = found.fetchone() or (None,)
            problem = '' if isinstance(data, bytes) else 'it has no data'
        except (sqlite3.Error, OverflowError) as error:
            data, problem = None, str(error)
        if problem:
            self._damage.note(
                (str(self.path), row),
                f'{self.path}: message {row} of the file, of {topic}, skipped: {problem}',
                1,
            )
        return data

    def _walk(self) -> Iterator[tuple[int, int, int]]:
        """Iterate over log time, id and topic of the rows; over what cannot be read in leaps."""
        assert self._database is not None
        query = 'SELECT timestamp, id, topic_id FROM messages WHERE id > ? ORDER BY id'
        last, leap = -1, 1
        while leap <= _WIDEST_GAP:
            try:
                for time_ns, row, topic in self._database.execute(query, (last,)):
                    last, leap = row, 1
                    if isinstance(time_ns, int) and isinstance(topic, int):
                        yield time_ns, row, topic
                return
            except sqlite3.Error as error:
                self._damage.note(
                    str(self.path),
                    f'{self.path}: damaged, {error}; the messages that can be read are read',
                )
                last, leap = last + leap, 2 * leap

    def _topics(self) -> list[Connection]:
        columns = self._columns('topics')
        if not columns or not self._columns('messages'):
            raise Unreadable('it has no tables topics and messages, as rosbag2 writes them')
        wanted = [name if name in columns else "''" for name in _TOPIC_COLUMNS]
        assert self._database is not None
        rows = self._database.execute(f'SELECT id, {", ".join(wanted)} FROM topics ORDER BY id')
        definitions = self._definitions()
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, '')
        return [
            Connection(
                row,
                name,
                kind,
                definitions.get(kind, nothing),
                digest or '',
                0,
                ConnectionExtRosbag2(serialisation, []),
                self,
            )
            for row, name, kind, serialisation, digest in rows
        ]

    def _definitions(self) -> dict[str, MessageDefinition]:
        if not self._columns('message_definitions'):
            return {}
        assert self._database is not None
        rows = self._database.execute(
            'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        )
        return {
            kind: MessageDefinition(_FORMATS[encoding], text)
            for kind, encoding, text in rows
            if encoding in _FORMATS
        }

    def _columns(self, table: str) -> set[str]:
        assert self._database is not None
        return {row[1] for row in self._database.execute(f'PRAGMA table_info({table})')}


_TOPIC_COLUMNS = ('name', 'type', 'serialization_format', 'type_description_hash')
