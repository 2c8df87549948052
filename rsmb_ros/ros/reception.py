"""Messages that come in: checked, handed to the worker, never worked on here."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rsmb_ros.messages.camera_info import Intrinsics, intrinsics_from_msg
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import (
    check_compressed,
    check_depth,
    check_image,
    image_from_compressed,
    image_from_msg,
)
from rsmb_ros.messages.stamps import stamp_ns

from .health import Health
from .logs import LOG_EVERY_S, Log
from .references import References
from .worker import Worker

# Causes of dropped frames, beside the worker's own.
MALFORMED = 'malformed'
PAUSED = 'paused'
BECAME_REFERENCE = 'became the reference'

# Fields that make the image of a message.
_OF_IMAGE = ('encoding', 'height', 'width', 'step', 'is_bigendian', 'data')
_OF_COMPRESSED = ('format', 'data')


@dataclass(frozen=True)
class Frame:
    """A live image on its way to the worker."""

    read: Callable[[], np.ndarray]  # (M, N) or (M, N, 3) uint8 BGR; may raise MalformedMessage
    header: Any  # std_msgs/Header
    stamp_ns: int  # 0: none
    arrived_s: float  # time.monotonic


class Reception:
    """
    Callbacks of the input topics.

    Parameters
    ----------
    compressed : bool
        Images come as CompressedImage.
    worker : Worker
        Receives frames and references.
    health : Health
        Is told what came.
    on_intrinsics : callable
        Receives what camera_info says.
    max_megapixels : callable
        Returns the largest image allowed now [Mpx].
    now_ns : callable
        Returns the node's time [ns].
    log : Log

    """

    def __init__(
        self,
        compressed: bool,
        worker: Worker[Frame, References],
        health: Health,
        on_intrinsics: Callable[[Intrinsics], None],
        max_megapixels: Callable[[], float],
        now_ns: Callable[[], int],
        log: Log,
    ) -> None:
        self._check = check_compressed if compressed else check_image
        self._convert = image_from_compressed if compressed else image_from_msg
        self._worker = worker
        self._health = health
        self._on_intrinsics = on_intrinsics
        self._max_megapixels = max_megapixels
        self._now_ns = now_ns
        self._log = log
        content = _OF_COMPRESSED if compressed else _OF_IMAGE
        self._references = References(self._convert, content, health, log)
        self._newest_ns = 0
        self._distortion_told = False
        self.paused = False
        self.next_is_reference = False

    def image(self, msg: Any) -> None:
        """Take a live image; it is converted in the worker, and only if its turn comes."""
        arrived_s = time.monotonic()
        try:
            stamp = stamp_ns(msg.header.stamp)
            self._check(msg, self._max_megapixels())
        except MalformedMessage as error:
            self._worker.refuse(MALFORMED)
            self._health.malformed(error.cause)
            self._log.warning(f'image skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
            return
        self._health.frame_received()
        self._note_stamp(stamp)
        if self.next_is_reference:
            self.next_is_reference = False
            self._worker.refuse(BECAME_REFERENCE)
            self.reference(msg)
        elif self.paused:
            self._worker.refuse(PAUSED)
        else:
            read = partial(self._convert, msg, self._max_megapixels())
            self._worker.submit_frame(Frame(read, msg.header, stamp, arrived_s))

    def reference(self, msg: Any) -> None:
        """Take a reference; it is decoded in the worker."""
        try:
            stamp = stamp_ns(msg.header.stamp)
            self._check(msg, self._max_megapixels())
        except MalformedMessage as error:
            self._health.malformed(error.cause)
            self._log.warning(f'reference skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
            return
        self._references.leave_image(msg, stamp, self._max_megapixels())
        self._worker.submit_reference(self._references)

    def depth(self, msg: Any) -> None:
        """Take the depth of a reference; it is converted in the worker."""
        try:
            stamp = stamp_ns(msg.header.stamp)
            check_depth(msg, self._max_megapixels())
        except MalformedMessage as error:
            self._health.malformed(error.cause)
            self._log.warning(f'depth skipped: {error}', throttle_duration_sec=LOG_EVERY_S)
            return
        self._references.leave_depth(msg, stamp, self._max_megapixels())
        self._worker.submit_reference(self._references)

    def camera_info(self, msg: Any) -> None:
        """Take the intrinsics."""
        try:
            intrinsics = intrinsics_from_msg(msg)
        except MalformedMessage as error:
            self._log.warning(f'camera_info ignored: {error}', throttle_duration_sec=LOG_EVERY_S)
            return
        if intrinsics.distorted and not self._distortion_told:
            self._distortion_told = True
            self._log.info(
                'camera_info tells of lens distortion: it is not modelled, and images must not be '
                'rectified either, since a rectified row is no longer read at one time'
            )
        self._on_intrinsics(intrinsics)

    def _note_stamp(self, stamp: int) -> None:
        """Tell health of a stamp that time does not explain; the frame is used all the same."""
        if not stamp:
            return
        if stamp < self._newest_ns:
            self._health.odd_stamp('backwards')
        if stamp > self._now_ns():
            self._health.odd_stamp('ahead of the clock')
        self._newest_ns = stamp
