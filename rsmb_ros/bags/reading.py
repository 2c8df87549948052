"""One reader for every kind of recording: rosbag2 folder, .mcap, .db3 and ROS 1 .bag."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rosbags.interfaces import Connection

from rsmb_ros.core.errors import BagError
from rsmb_ros.messages.camera_info import Intrinsics, intrinsics_from_msg
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import image_from_compressed, image_from_msg
from rsmb_ros.messages.stamps import stamp_ns

from .damage import Damage
from .recording import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    NAV_SAT_FIX,
    BagFrame,
    Label,
    Recording,
    Topic,
    Wanted,
    every,
)
from .storage import open_reader, storage_files

FORMATS = 'a rosbag2 folder, .mcap, .db3 or ROS 1 .bag'

_DECODERS = {IMAGE: image_from_msg, COMPRESSED: image_from_compressed}
# What a message raises whose definition, in the bag, is damaged.
_NOT_AS_DEFINED = (AttributeError, TypeError, IndexError)
_log = logging.getLogger(__name__)

T = TypeVar('T')


class Bag(Recording):
    """
    A recording, opened for reading; a context manager.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, .mcap, .db3 or ROS 1 .bag.
    damage : Damage, optional
        That of another reader of the same bag: what is lost is told once.

    Raises
    ------
    BagError
        If there is no such file, it is damaged, none of these formats, or has no messages.

    """

    def __init__(self, path: Path, damage: Damage | None = None) -> None:
        super().__init__(path)
        self.damage = damage or self.damage
        if not path.exists():
            raise BagError(f'{path}: no such file or folder; a bag is {FORMATS}')
        with self._translated():
            if path.is_dir() and not (path / 'metadata.yaml').exists() and not storage_files(path):
                raise BagError(
                    f'{path}: a folder with neither metadata.yaml, .mcap nor .db3 is no bag'
                )
            self._reader = open_reader(path, self.damage)
        self.topics = tuple(
            Topic(name, info.msgtype or 'several types', info.msgcount)
            for name, info in self._reader.topics.items()
        )
        if not any(topic.count for topic in self.topics):
            self._reader.close()
            if self.damage:
                raise BagError(f'{path}: none of its messages can be read; copy the file again')
            raise BagError(f'{path}: the bag has no messages; record it again')

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def span_ns(self) -> tuple[int, int] | None:
        """Return the log times of the first and the last message [ns]."""
        first, last = self._reader.start_time, self._reader.end_time
        return (first, last) if first <= last else None

    def focal_px(self) -> float | None:
        """Return the focal length of the binned image [px], if exactly one topic tells it."""
        intrinsics = self.intrinsics()
        return intrinsics.focal_px if intrinsics else None

    def intrinsics(self) -> Intrinsics | None:
        """Return what the first camera_info tells, if there is exactly one topic of them."""
        topics = [topic for topic in self.topics if topic.type == CAMERA_INFO and topic.count]
        if len(topics) != 1:
            return None
        for _, _, read in self._stored((topics[0].name,)):
            try:
                info = read()
            except (MalformedMessage, *_NOT_AS_DEFINED):
                continue
            try:
                return intrinsics_from_msg(info)
            except MalformedMessage as error:
                _log.warning('%s: %s: %s', self.path, topics[0].name, error)
                return None
            except _NOT_AS_DEFINED:
                continue
        name = topics[0].name
        text = f'{self.path}: no message of {name} can be read: the focal length is not known'
        self.damage.note(name, text)
        return None

    def messages(self, *names: str) -> Iterator[tuple[str, int, Any]]:
        """Iterate over topic, log time [ns] and message of the topics `names`, by log time."""
        for topic, time_ns, read in self._stored(names):
            try:
                message = read()
            except MalformedMessage as error:
                raise BagError(f'{self.path}: a message of {topic} is damaged: {error}') from error
            yield topic, time_ns, message

    def each(self, name: str, convert: Callable[[Any], T]) -> Iterator[T]:
        """
        Iterate over what `convert` makes of the messages of a topic, by log time.

        Messages that cannot be read are left out; when the others are through, they are told and
        counted as one loss.
        """
        broken, first = 0, ''
        for index, (_, _, read) in enumerate(self._stored((name,))):
            try:
                found = convert(read())
            except (MalformedMessage, *_NOT_AS_DEFINED) as error:
                broken += 1
                first = first or f'message {index}: {error}'
                continue
            yield found
        if broken:
            several = f'{broken} messages of {name} skipped, the first is '
            what = several if broken > 1 else f'{name} skipped: '
            self.damage.note((name, 'broken'), f'{self.path}: {what}{first}', lost=broken)

    def readable(self, name: str) -> tuple[int, int]:
        """
        Return how many messages of the topic `name` are whole, and how many are not.

        Of types that nothing is made of here only that they are stored counts: a bag may hold
        them in a version of the type that it does not tell.
        """
        whole, broken = 0, 0
        for _, _, read in self._stored((name,)):
            try:
                if self.topic(name).type in (CAMERA_INFO, NAV_SAT_FIX):
                    read()
                whole += 1
            except MalformedMessage:
                broken += 1
        return whole, broken

    def cdr(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """
        Iterate over topic, log time [ns] and serialised message, by log time.

        Raises
        ------
        BagError
            If the bag is of ROS 1, whose messages are serialised in another way.

        """
        if not self._reader.is2:
            raise BagError(f'{self.path}: a ROS 1 bag; convert it first: rosbags-convert')
        with self._translated():
            for connection, time_ns, data in self._reader.messages(self._connections(names)):
                yield connection.topic, time_ns, bytes(data)

    def frames(self, *names: str, wanted: Wanted = every) -> Iterator[BagFrame]:
        """Iterate over the images of the topics `names`, by log time; see `Recording.frames`."""
        decode = {self.image_topic(name).name: _DECODERS[self.topic(name).type] for name in names}
        seen: Counter[str] = Counter()
        for topic, time_ns, read in self._stored(names):
            index = seen[topic]
            seen[topic] += 1
            try:
                message = read()
                label = Label(topic, index, time_ns, stamp_ns(message.header.stamp))
                if not wanted(label):
                    continue
                header, image = message.header, decode[topic](message)
                frame_id = str(header.frame_id)
            except (MalformedMessage, *_NOT_AS_DEFINED) as error:
                self.skipped[topic] += 1
                _log.warning('%s: message %d of %s skipped: %s', self.path, index, topic, error)
                continue
            yield BagFrame(topic, index, time_ns, label.stamp_ns, frame_id, image, header)

    def _stored(self, names: tuple[str, ...]) -> Iterator[tuple[str, int, Callable[[], Any]]]:
        """Iterate over topic, log time [ns] and what deserialises the message."""
        with self._translated():
            for connection, time_ns, data in self._reader.messages(self._connections(names)):
                yield connection.topic, time_ns, partial(self._message, data, connection.msgtype)

    def _message(self, data: bytes, kind: str) -> Any:
        try:
            return self._reader.deserialize(data, kind)
        except Exception as error:  # whatever the generated code meets in damaged data
            raise MalformedMessage('undecodable', f'no {kind}: {error}') from error

    def _connections(self, names: tuple[str, ...]) -> list[Connection]:
        wanted = {self.topic(name).name for name in names}
        return [c for c in self._reader.connections if c.topic in wanted]

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn what the library raises for damaged files into a `BagError`."""
        try:
            yield
        except BagError:
            raise
        except Exception as error:  # besides its own, the decoders' of damaged data
            reason = str(error).rstrip('.')
            raise BagError(
                f'{self.path}: cannot be read as a bag: {reason}; must be {FORMATS}, complete'
            ) from error
