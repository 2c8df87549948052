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
    reader.open()
    return reader


class _Folder(DirectoryReader):
    """A folder with metadata.yaml."""

    def __init__(self, path: Path, damage: Damage) -> None:
        super().__init__(path)
        self._damage = damage
        self.STORAGE_PLUGINS: Any = {
            'mcap': partial(McapStorage, damage=damage),
            'sqlite3': partial(SqliteStorage, damage=damage),
        }

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Iterate over messages; one whose own compression is damaged comes out empty."""
        told = self.metadata
        if told.compression_mode != 'message':
            yield from super().messages(connections, start, stop)
            return
        # the library would end at the first message that it cannot decompress
        self.metadata = told._replace(compression_mode=None)
        for connection, time_ns, data in super().messages(connections, start, stop):
            yield connection, time_ns, _decompressed(data)


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
