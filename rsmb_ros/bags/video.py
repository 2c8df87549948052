"""Video files as recordings."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import cv2

from rsmb_ros.core.errors import BagError

from .recording import FRAMES, BagFrame, Label, Recording, Topic, Wanted, every
from .writing import BagFactory

SUFFIXES = ('.mp4', '.m4v', '.mov', '.avi', '.mkv', '.webm', '.mpg', '.mpeg', '.ts', '.mts')
TOPIC = '/image'
FRAME_ID = 'camera'

_log = logging.getLogger(__name__)


class Video(Recording):
    """
    A video file; its frames are the topic ``/image``.

    Parameters
    ----------
    path : Path
    rate : float, optional
        Frames a second; None: the times that the file gives its frames.

    Notes
    -----
    Stamps count from 0 at the start of the file. They are nanoseconds rounded from what the file
    says, or index / rate.

    Raises
    ------
    BagError
        If OpenCV cannot open it.

    """

    def __init__(self, path: Path, rate: float | None = None) -> None:
        super().__init__(path)
        self._rate = rate
        video = self._opened()
        self._count = max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))
        self._usual_rate = rate or video.get(cv2.CAP_PROP_FPS)
        video.release()
        self.topics = (Topic(TOPIC, FRAMES, self._count),)

    def close(self) -> None:
        """Nothing is open between two iterations."""

    def span_ns(self) -> tuple[int, int] | None:
        """Return about when the first and the last frame are [ns], None where no rate is told."""
        if not self._usual_rate > 0:
            return None
        return 0, round(max(0, self._count - 1) * 1e9 / self._usual_rate)

    def frames(self, *names: str, wanted: Wanted = every) -> Iterator[BagFrame]:
        """Iterate over the frames; see `Recording.frames`."""
        factory, video, index = BagFactory(), self._opened(), 0
        try:
            while names and video.grab():
                time_ns = self._time_ns(video, index)
                label = Label(TOPIC, index, time_ns, time_ns)
                index += 1
                if not wanted(label):
                    continue
                ok, image = video.retrieve()
                if not ok:
                    self._skip(f'frame {label.index} cannot be decoded', 1)
                    continue
                header = factory.header(time_ns, FRAME_ID)
                yield BagFrame(TOPIC, label.index, time_ns, time_ns, FRAME_ID, image, header)
        finally:
            video.release()
        if index < self._count:
            told = f'{self._count} frames are announced, only {index} can be read'
            self._skip(f'{told}; the file may be cut off', self._count - index)

    def _opened(self) -> cv2.VideoCapture:
        video = cv2.VideoCapture(str(self.path))
        if not video.isOpened():
            raise BagError(
                f'{self.path}: OpenCV cannot read it as a video; convert it, for example with '
                f'ffmpeg -i {self.path.name} out.mp4'
            )
        return video

    def _time_ns(self, video: cv2.VideoCapture, index: int) -> int:
        if self._rate:
            return round(index * 1e9 / self._rate)
        return round(video.get(cv2.CAP_PROP_POS_MSEC) * 1e6)

    def _skip(self, reason: str, frames: int) -> None:
        self.skipped[TOPIC] += frames
        _log.warning('%s: %s', self.path, reason)
