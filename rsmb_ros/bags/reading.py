"""One reader for every kind of recording: rosbag2 folder, .mcap, .db3 and ROS 1 .bag."""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from rsmb_ros.core.errors import BagError
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import image_from_compressed, image_from_msg
from rsmb_ros.messages.stamps import stamp_ns

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
FORMATS = 'a rosbag2 folder, .mcap, .db3 or ROS 1 .bag'

_DECODERS = {IMAGE: image_from_msg, COMPRESSED: image_from_compressed}
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Topic:
    """One topic of a bag."""

    name: str
    type: str  # 'sensor_msgs/msg/Image'
    count: int  # messages

    @property
    def is_image(self) -> bool:
        """Whether frames can be read from it."""
        return self.type in _DECODERS

    @property
    def plain_name(self) -> str:
        """Name of the raw image: without the ``/compressed`` of its transport."""
        return self.name.removesuffix('/compressed')


@dataclass(frozen=True)
class BagFrame:
    """One image of a bag."""

    topic: str
    index: int  # among the messages of its topic, those that could not be read included
    log_time_ns: int  # when it was recorded [ns]
    stamp_ns: int  # of its header [ns]
    frame_id: str
    image: np.ndarray  # (M, N) or (M, N, 3) uint8, grey or BGR
    header: Any  # std_msgs/Header as the bag has it


class Bag:
    """
    A recording, opened for reading; a context manager.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, .mcap, .db3 or ROS 1 .bag.

    Raises
    ------
    BagError
        If there is no such file, it is damaged, none of these formats, or has no messages.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.skipped: Counter[str] = Counter()  # topic -> images that could not be read
        if not path.exists():
            raise BagError(f'{path}: no such file or folder; a bag is {FORMATS}')
        with self._translated():
            # sqlite3 bags carry no type definitions
            jazzy = get_typestore(Stores.ROS2_JAZZY)
            self._reader = AnyReader([path], default_typestore=jazzy)
            self._reader.open()
        self.topics = tuple(
            Topic(name, info.msgtype or 'several types', info.msgcount)
            for name, info in self._reader.topics.items()
        )
        if not any(topic.count for topic in self.topics):
            self._reader.close()
            raise BagError(f'{path}: the bag has no messages; record it again')

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def topic(self, name: str) -> Topic:
        """Return the topic `name`; a `BagError` lists those that are there."""
        for topic in self.topics:
            if topic.name.lstrip('/') == name.lstrip('/'):
                return topic
        raise BagError(f'{self.path}: topic {name} is not in the bag; it has {self._listed()}')

    def image_topic(self, name: str) -> Topic:
        """Return the topic `name`, which must hold images."""
        topic = self.topic(name)
        if not topic.is_image:
            raise BagError(
                f'{self.path}: topic {topic.name} holds {topic.type}, must be {IMAGE} or '
                f'{COMPRESSED}; the bag has {self._listed()}'
            )
        return topic

    def guess_reference(self) -> Topic:
        """Return the only image topic called ``reference/image`` or ``.../compressed``."""
        found = [topic for topic in self._images() if is_reference(topic)]
        return self._only(found, 'reference', 'give one with --reference TOPIC or --reference FILE')

    def guess_live(self, reference: str | None) -> Topic:
        """Return the only image topic beside the reference, of several the one named ``image``."""
        others = [t for t in self._images() if t.name != reference and not is_reference(t)]
        named = [topic for topic in others if topic.plain_name.split('/')[-1] == 'image']
        return self._only(named or others, 'live image', 'give one with --topic NAME')

    def focal_px(self) -> float | None:
        """Return the focal length [px] if there is exactly one camera_info topic."""
        topics = [topic for topic in self.topics if topic.type == CAMERA_INFO and topic.count]
        if len(topics) != 1:
            return None
        _, _, info = next(self.messages(topics[0].name))
        # ROS 1 calls the matrix K, ROS 2 k
        focal = float((info.K if hasattr(info, 'K') else info.k)[0])
        return focal if math.isfinite(focal) and focal > 0 else None

    def messages(self, *names: str) -> Iterator[tuple[str, int, Any]]:
        """Iterate over topic, log time [ns] and message of the topics `names`, by log time."""
        for topic, time_ns, read in self._stored(names):
            try:
                message = read()
            except MalformedMessage as error:
                raise BagError(f'{self.path}: a message of {topic} is damaged: {error}') from error
            yield topic, time_ns, message

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

    def frames(self, *names: str) -> Iterator[BagFrame]:
        """
        Iterate over the images of the topics `names`, by log time.

        An image that cannot be read is counted in `skipped` and logged as a warning.
        """
        decode = {self.image_topic(name).name: _DECODERS[self.topic(name).type] for name in names}
        seen: Counter[str] = Counter()
        for topic, time_ns, read in self._stored(names):
            index = seen[topic]
            seen[topic] += 1
            try:
                message = read()
                stamp, image = stamp_ns(message.header.stamp), decode[topic](message)
            except MalformedMessage as error:
                self.skipped[topic] += 1
                _log.warning('%s: message %d of %s skipped: %s', self.path, index, topic, error)
                continue
            header = message.header
            yield BagFrame(topic, index, time_ns, stamp, header.frame_id, image, header)

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

    def _images(self) -> list[Topic]:
        return [t for t in self.topics if t.is_image and t.count and not is_truth(t)]

    def _only(self, found: list[Topic], what: str, remedy: str) -> Topic:
        if len(found) == 1:
            return found[0]
        several = ', '.join(topic.name for topic in found)
        problem = f'several {what} topics ({several})' if found else f'no {what} topic'
        raise BagError(f'{self.path}: {problem}; {remedy}; the bag has {self._listed()}')

    def _listed(self) -> str:
        return ', '.join(f'{t.name} ({t.type}, {t.count} messages)' for t in self.topics)

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """Turn what the library raises for damaged files into a `BagError`."""
        try:
            yield
        except FileNotFoundError as error:
            raise BagError(
                f'{self.path}: a folder without metadata.yaml is no bag; '
                'name the .mcap or .db3 file inside it'
            ) from error
        except BagError:
            raise
        except Exception as error:  # besides its own, the decoders' of damaged data
            reason = str(error).rstrip('.')
            raise BagError(
                f'{self.path}: cannot be read as a bag: {reason}; must be {FORMATS}, complete'
            ) from error


def is_reference(topic: Topic) -> bool:
    """Return whether the topic is named as a reference."""
    return topic.plain_name.split('/')[-2:] == ['reference', 'image']


def is_truth(topic: Topic) -> bool:
    """Return whether the topic holds truth, which is no input of a node."""
    return topic.name.lstrip('/').startswith('truth/')
