"""The library's reader of a bag, of whatever format."""

from __future__ import annotations

from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from .damage import Damage
from .names import by_number

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
    reader.open()
    return reader
