"""What every kind of recording offers: its topics, and the frames of some of them in order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import numpy as np

from rsmb_ros.core.errors import BagError

from .damage import Damage

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
NAV_SAT_FIX = 'sensor_msgs/msg/NavSatFix'
FRAMES = 'frames'  # type of the one topic of a video or a folder of images
IMAGE_TYPES = (IMAGE, COMPRESSED, FRAMES)

AnyRecording = TypeVar('AnyRecording', bound='Recording')


@dataclass(frozen=True)
class Topic:
    """One topic of a recording."""

    name: str
    type: str  # 'sensor_msgs/msg/Image'
    count: int  # messages

    @property
    def is_image(self) -> bool:
        """Whether frames can be read from it."""
        return self.type in IMAGE_TYPES

    @property
    def plain_name(self) -> str:
        """Name of the raw image: without the ``/compressed`` of its transport."""
        return self.name.removesuffix('/compressed')


@dataclass(frozen=True)
class Label:
    """All there is to know of a frame before it is decoded."""

    topic: str
    # Among the messages of its topic: those that could not be decoded included, those lost with
    # damaged parts of the file not.
    index: int
    log_time_ns: int  # when it was recorded [ns]
    stamp_ns: int  # of its header [ns]

    @property
    def time_ns(self) -> int:
        """Its stamp, or where that is zero, when it was recorded [ns]."""
        return self.stamp_ns or self.log_time_ns


@dataclass(frozen=True)
class BagFrame(Label):
    """One image of a recording."""

    frame_id: str
    image: np.ndarray  # (M, N) or (M, N, 3) uint8, grey or BGR
    header: Any  # std_msgs/Header as the bag has it


class NoMore(Exception):
    """Raised by `Wanted`: no frame that follows is wanted, the iteration ends with this."""


Wanted = Callable[[Label], bool]


def every(label: Label) -> bool:
    """Want every frame."""
    return True


class Recording(ABC):
    """
    A recording, opened for reading; a context manager.

    Parameters
    ----------
    path : Path

    """

    topics: tuple[Topic, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        self.skipped: Counter[str] = Counter()  # topic -> images that could not be read
        self.damage = Damage()  # what of the file could not be read at all

    def __enter__(self: AnyRecording) -> AnyRecording:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Let go of the file."""

    @abstractmethod
    def frames(self, *names: str, wanted: Wanted = every) -> Iterator[BagFrame]:
        """
        Iterate over the images of the topics `names`, by log time.

        An image that cannot be read is counted in `skipped` and logged as a warning; one that is
        not `wanted` is not decoded.
        """

    def span_ns(self) -> tuple[int, int] | None:
        """Return about when it starts and ends [ns], None where that is not known beforehand."""
        return None

    def focal_px(self) -> float | None:
        """Return the focal length [px] if the recording tells exactly one."""
        return None

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
        remedy = (
            'give one with --reference FILE, --reference TOPIC or --reference @0, the first frame'
        )
        return self._only(found, 'reference', remedy)

    def guess_live(self, reference: str | None) -> Topic:
        """Return the only image topic beside the reference, of several the one named ``image``."""
        others = [t for t in self._images() if t.name != reference and not is_reference(t)]
        named = [topic for topic in others if topic.plain_name.split('/')[-1] == 'image']
        return self._only(named or others, 'live image', 'give one with --topic NAME')

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


def is_reference(topic: Topic) -> bool:
    """Return whether the topic is named as a reference."""
    return topic.plain_name.split('/')[-2:] == ['reference', 'image']


def is_truth(topic: Topic) -> bool:
    """Return whether the topic holds truth, which is no input of a node."""
    return topic.name.lstrip('/').startswith('truth/')
