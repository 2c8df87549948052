"""References and their depth on the way to the worker, which decodes and pairs them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsmb_ros.core.depth_map import checked_depth
from rsmb_ros.core.errors import FrameError
from rsmb_ros.messages.images import depth_from_msg

from .health import Health
from .logs import LOG_EVERY_S, Log
from .pairing import Pair, Pairing

# Messages that wait. The newest that can be read is taken: a file that only its decoder can tell
# is broken must not push out a good one that came before it.
_MOST_UNREAD = 4


@dataclass(frozen=True)
class _Unread:
    msg: Any  # sensor_msgs/Image or CompressedImage
    stamp_ns: int  # 0: none
    max_megapixels: float


class References:
    """
    What callbacks leave and the worker takes.

    Parameters
    ----------
    convert : callable
        Reads a message with a limit [Mpx]; may raise MalformedMessage.
    content : sequence of str
        Fields of such a message that make its image.
    health : Health
        Is told what came.
    log : Log

    """

    def __init__(
        self,
        convert: Callable[[Any, float], np.ndarray],
        content: Sequence[str],
        health: Health,
        log: Log,
    ) -> None:
        self._convert = convert
        self._content = content
        self._health = health
        self._log = log
        self._lock = threading.Lock()
        self._images: deque[_Unread] = deque(maxlen=_MOST_UNREAD)
        self._depths: deque[_Unread] = deque(maxlen=_MOST_UNREAD)
        self._pairing = Pairing()
        self._last: tuple[Any, np.ndarray] | None = None  # the last message read, its image

    def leave_image(self, msg: Any, stamp_ns: int, max_megapixels: float) -> None:
        """Leave a reference image."""
        with self._lock:
            self._images.append(_Unread(msg, stamp_ns, max_megapixels))

    def leave_depth(self, msg: Any, stamp_ns: int, max_megapixels: float) -> None:
        """Leave a depth image."""
        with self._lock:
            self._depths.append(_Unread(msg, stamp_ns, max_megapixels))

    def take(self) -> Pair | None:
        """Read what was left; return what is to be used from now on, None: as before."""
        with self._lock:
            images, depths = list(self._images), list(self._depths)
            self._images.clear()
            self._depths.clear()
        new = self._take_image(images)
        if new is not None:
            self._health.reference_received()
        return self._take_depth(depths) or new

    def _take_image(self, unread: list[_Unread]) -> Pair | None:
        for one in reversed(unread):
            try:
                image = self._read(one)
            except FrameError as error:
                self._health.malformed(getattr(error, 'cause', 'reference'))
                self._log.warning(f'reference skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
            else:
                # A latched publisher reaches both subscriptions, and some repeat their image for
                # ever: an equal reference changes nothing.
                return self._pairing.image(image, one.stamp_ns)
        return None

    def _take_depth(self, unread: list[_Unread]) -> Pair | None:
        for one in reversed(unread):
            try:
                depth = depth_from_msg(one.msg, one.max_megapixels)
                pair = self._pairing.depth(checked_depth(depth, depth.shape), one.stamp_ns)
            except FrameError as error:
                self._health.malformed(getattr(error, 'cause', 'depth'))
                self._log.warning(f'depth skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
                continue
            if pair is None and (waiting := self._pairing.waiting()):
                self._log.info(
                    f'depth waits for its reference: {waiting}', throttle_duration_sec=LOG_EVERY_S
                )
            return pair
        return None

    def _read(self, unread: _Unread) -> np.ndarray:
        """Return the image of a message; decoding is slower than to see that it is the last one."""
        if self._last is not None and self._equal(unread.msg, self._last[0]):
            return self._last[1]
        image = self._convert(unread.msg, unread.max_megapixels)
        self._last = unread.msg, image
        return image

    def _equal(self, msg: Any, other: Any) -> bool:
        return all(
            np.array_equal(getattr(msg, name), getattr(other, name)) for name in self._content
        )
