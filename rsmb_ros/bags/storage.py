"""The library's reader of a bag, with storages that survive damage."""

from __future__ import annotations

from collections.abc import Collection, Generator
from functools import partial
from pathlib import Path
from typing import Any

import zstandard
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2.reader import DirectoryReader, Reader
from rosbags.typesys import Stores, get_typestore

from .damage import Damage
from .mcap_storage import McapStorage
from .names import by_number
from .rosbag1_scan import Rosbag1Scan
from .sqlite_storage import SqliteStorage

STORED = ('.mcap', '.db3')


def storage_files(folder: Path) -> list[Path]:
    """Return the .mcap or .db3 files of a folder in the order they were recorded."""
    return sorted((p for p in folder.iterdir() if p.suffix in STORED), key=by_number)


def open_reader(path: Path, damage: Damage) -> AnyReader:
    """
    Open a bag.

    Parameters
    ----------
    path : Path
        File or folder.
    damage : Damage
        Is told what cannot be read.

    """
    files = [path]
    if path.is_dir() and not (path / 'metadata.yaml').exists():
        files = storage_files(path)
        damage.note(
            path,
            f'{path}: no metadata.yaml, the recording was not finished; '
            f'the {len(files)} files inside are read as they are',
        )
    # sqlite3 bags carry no type definitions
    reader = AnyReader(files, default_typestore=get_typestore(Stores.ROS2_JAZZY))
    if reader.is2:
        reader.readers = [_File(file, damage) for file in files]
    try:
        reader.open()
    except Exception as error:
        if reader.is2:
            raise
        reader = _without_index(path, damage, error)
    if any(file.suffix != '.mcap' for file in files if file.is_file()):
        damage.unchecked.append(f'{path}: has no CRC; damage inside of messages cannot be told')
    return reader


def _without_index(path: Path, damage: Damage, error: Exception) -> AnyReader:
    """Open a ROS 1 bag whose index is missing or damaged."""
    reason = str(error).rstrip('.')
    damage.note(path, f'{path}: {reason}; the file is walked through')
    reader = AnyReader([path])
    scan: Any = Rosbag1Scan(path, damage)
    reader.readers = [scan]
    reader.open()
    return reader


class _Folder(DirectoryReader):
    """A folder with metadata.yaml."""

    def __init__(self, path: Path, damage: Damage) -> None:
        super().__init__(path)
        self._each = False  # message is compressed by itself
        self.STORAGE_PLUGINS: Any = {
            'mcap': partial(McapStorage, damage=damage),
            'sqlite3': partial(SqliteStorage, damage=damage),
        }

    def open(self) -> None:
        """Open the files."""
        super().open()
        self._each = self.metadata.compression_mode == 'message'

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """
        Iterate over messages; one whose own compression is damaged comes out empty.

        The library passes over a topic whose QoS in metadata.yaml is not that of the files, as in
        bags that were converted from old ones; here name and type are enough.
        """
        for storage in self.storages:
            same = {
                stored.id: told
                for stored in storage.connections
                for told in reversed(list(connections))
                if (told.topic, told.msgtype) == (stored.topic, stored.msgtype)
            }
            known = [stored for stored in storage.connections if stored.id in same]
            for stored, time_ns, data in storage.messages(known, start, stop) if known else ():
                yield same[stored.id], time_ns, _decompressed(data) if self._each else data


def _decompressed(data: bytes) -> bytes:
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except (zstandard.ZstdError, MemoryError):
        return b''  # will be told and counted as a message that cannot be read


class _File(Reader):
    """A folder or a single file."""

    def __init__(self, path: Path, damage: Damage) -> None:
        self.STORAGE_PLUGINS: Any = {
            'dir': partial(_Folder, damage=damage),
            '.mcap': partial(McapStorage, damage=damage),
            '.db3': partial(SqliteStorage, damage=damage),
        }
        super().__init__(path)
