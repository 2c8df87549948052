"""What a batch has done so far: DIR/manifest.json, right at every moment."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from rsmb_ros.core.errors import FileProblem

from .tasks import Counts
from .wishes import Wish

FILE = 'manifest.json'
LOCK = '.manifest.lock'
FORMAT = 1
DONE, FAILED, PENDING = 'done', 'failed', 'pending'


@dataclass(frozen=True)
class Entry:
    """One recording."""

    name: str  # of its outputs
    bag: str  # absolute path
    status: str  # DONE, FAILED or PENDING: not begun, or stopped
    outputs: tuple[str, ...]  # names of its files in the folder
    wish: Wish
    reason: str = ''  # of a failure
    counts: Counts | None = None  # None unless done
    seconds: float = 0.0  # wall-clock
    warnings: tuple[str, ...] = ()


class Manifest:
    """
    The entries of a folder, by name; written anew, as a whole, with each change.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    FileProblem
        If there is a manifest that is none of ours.

    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._entries = {entry.name: entry for entry in _read(self.path)}

    def get(self, name: str) -> Entry | None:
        """Return the entry of a name."""
        return self._entries.get(name)

    def names(self) -> dict[Path, list[str]]:
        """Return the names that recordings have."""
        found: dict[Path, list[str]] = {}
        for entry in self._entries.values():
            found.setdefault(Path(entry.bag), []).append(entry.name)
        return found

    def put(self, *entries: Entry) -> None:
        """Take entries, in place of those of the same names, and write all."""
        self._entries |= {entry.name: entry for entry in entries}
        content = {
            'format': FORMAT,
            'bags': [asdict(self._entries[name]) for name in sorted(self._entries)],
        }
        part = self.path.with_name(self.path.name + '.part')
        try:
            with part.open('w', encoding='utf-8') as stream:
                json.dump(content, stream, indent=1, allow_nan=False)
                stream.flush()
                os.fsync(stream.fileno())  # a name without content is worse than an old one
            part.replace(self.path)
        except OSError as error:
            raise FileProblem(f'{self.path}: cannot be written: {error.strerror}') from error


@contextmanager
def only_batch(folder: Path) -> Iterator[None]:
    """
    Keep other batches out of a folder; the system lets go of it even if the process is killed.

    Raises
    ------
    FileProblem
        If there is one at work, or the folder cannot be written.

    """
    path = folder / LOCK
    try:
        stream = path.open('w')
    except OSError as error:
        raise FileProblem(f'{folder}: cannot be written: {error.strerror}') from error
    with stream:
        try:
            _lock(stream)
        except OSError as error:
            raise FileProblem(
                f'{folder}: another rsmb batch is writing there; wait for it, or choose another -o'
            ) from error
        yield


def _lock(stream: IO[str]) -> None:
    with suppress(ImportError):  # outside of POSIX there is no lock
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _read(path: Path) -> list[Entry]:
    try:
        content = json.loads(path.read_text('utf-8'))
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise _no_manifest(path, error) from error
    try:
        if content['format'] != FORMAT:
            raise ValueError(f'format {content["format"]}, this version reads {FORMAT}')
        return [_entry(values) for values in content['bags']]
    except (KeyError, TypeError, ValueError) as error:
        raise _no_manifest(path, error) from error


def _entry(values: dict[str, Any]) -> Entry:
    counts = values['counts']
    changed = {
        'outputs': tuple(values['outputs']),
        'wish': Wish(**values['wish']),
        'counts': None if counts is None else Counts(**counts),
        'warnings': tuple(values['warnings']),
    }
    return Entry(**{**values, **changed})


def _no_manifest(path: Path, error: Exception) -> FileProblem:
    return FileProblem(
        f'{path}: is no manifest of rsmb batch: {type(error).__name__}: {error}; '
        'move it away, or choose another -o'
    )
