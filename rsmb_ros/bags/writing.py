"""Recordings as one .mcap file that every ROS 2 tool reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import rsmb_ros
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import BagError
from rsmb_ros.messages.as_json import to_json

from .factory import BagFactory
from .mcap_file import McapFile
from .mcap_scan import Scan
from .typestore import definition, serialised

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

__all__ = ['METADATA', 'BagFactory', 'BagWriter', 'Kept', 'part_of', 'provenance']

METADATA = 'rsmb'  # name of the record with version and configuration
_CHUNK_BYTES = 1 << 20  # uncompressed

# What rosbag2 of Jazzy writes for a publisher; `ros2 bag play` offers its topics like this. From a
# file without metadata of its own it takes names, not the numbers of older versions.
_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


class Kept(NamedTuple):
    """What is kept of an unfinished file."""

    scan: Scan
    chunks: int  # the first so many


class BagWriter:
    """
    Writes one .mcap; a context manager.

    The file appears under its name when the block is left, however it is left: an interrupted
    recording is shorter, never damaged. Until then it has the suffix ``.part``, and is whole up to
    its last chunk even if the process is killed.

    Parameters
    ----------
    path : Path
        Must end in .mcap; an existing file is replaced.
    config : Config, optional
        Written into the file beside the version.
    notes : mapping of str to str
        Also written into it.
    chunk_bytes : int, optional
        A chunk ends where it is larger; None: only where `flush` is called.
    kept : Kept, optional
        Go on with the unfinished file after these chunks, whose configuration and notes stay.

    Raises
    ------
    BagError
        If the name is wrong or the file cannot be written.

    """

    def __init__(
        self,
        path: Path,
        config: Config | None = None,
        notes: Mapping[str, str] | None = None,
        chunk_bytes: int | None = _CHUNK_BYTES,
        kept: Kept | None = None,
    ) -> None:
        if path.suffix != '.mcap':
            raise BagError(f'{path}: an output bag must be named *.mcap')
        self.path = path
        self._part = part_of(path)
        self._chunk_bytes = chunk_bytes
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._failed = False
        with self._translated():
            self._stream = self._part.open('ab' if kept is None else 'r+b')
        self._lock()
        with self._translated():
            if kept is None:
                self._stream.truncate(0)  # not before it is ours
                self._stream.seek(0)
                self._file = McapFile(self._stream)
                self._file.start('ros2', f'rsmb_ros {rsmb_ros.__version__}')
                self._file.add_metadata(METADATA, provenance(config) | dict(notes or {}))
                self._stream.flush()
            else:
                self._go_on(*kept)

    def _go_on(self, scan: Scan, chunks: int) -> None:
        """Cut the file behind its first `chunks` chunks and take over what they hold."""
        self._stream.truncate(scan.end(chunks))
        self._stream.seek(0, 2)
        held = scan.contents(chunks)
        self._schemas = {schema.name: schema.id for schema in held.schemas.values()}
        self._channels = {channel.topic: channel.id for channel in held.channels.values()}
        self._file = McapFile(self._stream, held)

    def _lock(self) -> None:
        """Keep other processes from writing the same file, where the system can."""
        if fcntl is None:
            return
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._stream.close()
            raise BagError(
                f'{self.path}: another process is writing it; wait for it, or choose another name'
            ) from error
        except OSError:  # a network drive without locks
            return

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Finish the file and give it its name; not if it could not be written."""
        if self._failed:
            with suppress(OSError):  # was told already
                self._stream.close()
            return
        with self._translated(), self._stream:
            self._file.finish()
        self._part.replace(self.path)

    def write(self, topic: str, message: Any, log_time_ns: int, latched: bool = False) -> None:
        """
        Write a message made by `BagFactory` or read from a ROS 2 bag.

        Parameters
        ----------
        topic : str
        message : object of the rosbags type store
        log_time_ns : int
        latched : bool
            Played back transient_local, so that late subscribers receive it too.

        """
        self.write_cdr(topic, message.__msgtype__, serialised(message), log_time_ns, latched)

    def write_cdr(
        self, topic: str, kind: str, data: bytes, log_time_ns: int, latched: bool = False
    ) -> None:
        """Write a message of type `kind` ('std_msgs/msg/String') that is serialised already."""
        if topic not in self._channels:
            self._channels[topic] = self._file.add_channel(
                topic, 'cdr', self._schema(kind), _channel_metadata(latched)
            )
        self._file.add_message(self._channels[topic], log_time_ns, data)
        if self._chunk_bytes is not None:
            self.flush(self._chunk_bytes)

    def flush(self, from_bytes: int = 0) -> None:
        """End the chunk, if it is that large: what was written so far survives the process."""
        if self._file.pending > from_bytes:
            with self._translated():
                self._file.flush()

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text = definition(kind).encode()
            self._schemas[kind] = self._file.add_schema(kind, 'ros2msg', text)
        return self._schemas[kind]

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn what the operating system refuses into a `BagError`."""
        try:
            yield
        except OSError as error:
            self._failed = True
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from error


def part_of(path: Path) -> Path:
    """Return the name that an output has until it is finished."""
    return path.with_name(path.name + '.part')


def provenance(config: Config | None) -> dict[str, str]:
    """Return what every recording says of how it was made."""
    found = {'version': rsmb_ros.__version__}
    if config is not None:
        found['config'] = to_json(config.nested())
    return found


def _channel_metadata(latched: bool) -> dict[str, str]:
    depth, durability = (1, 'transient_local') if latched else (10, 'volatile')
    return {'offered_qos_profiles': _QOS.format(depth=depth, durability=durability)}
