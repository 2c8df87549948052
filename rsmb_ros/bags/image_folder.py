"""Folders of images as recordings."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

from rsmb_ros.core.errors import BagError, FileProblem

from .image_files import read_image
from .names import by_number
from .recording import FRAMES, BagFrame, Label, Recording, Topic, Wanted, every
from .writing import BagFactory

SUFFIXES = ('.png', '.jpg', '.jpeg')
RATE = 10.0  # Hz, where nobody says another: files have no stamps
TOPIC = '/image'
FRAME_ID = 'camera'

_log = logging.getLogger(__name__)


class ImageFolder(Recording):
    """
    The PNG and JPEG files of a folder, by name with numbers as numbers; they are ``/image``.

    Parameters
    ----------
    path : Path
    rate : float, optional
        Frames a second, 10 by default; frame n gets the stamp n / rate, the first one 0.

    Raises
    ------
    BagError
        If no such file is in the folder.

    """

    def __init__(self, path: Path, rate: float | None = None) -> None:
        super().__init__(path)
        self._rate = rate or RATE
        self._files = image_files(path)
        if not self._files:
            raise BagError(f'{path}: no {", ".join(SUFFIXES)} file is in the folder')
        self.topics = (Topic(TOPIC, FRAMES, len(self._files)),)

    def close(self) -> None:
        """Nothing is open between two iterations."""

    def span_ns(self) -> tuple[int, int]:
        """Return the stamps of the first and the last image [ns]."""
        return 0, round((len(self._files) - 1) * 1e9 / self._rate)

    def frames(self, *names: str, wanted: Wanted = every) -> Iterator[BagFrame]:
        """Iterate over the images; see `Recording.frames`."""
        factory = BagFactory()
        for index, path in enumerate(self._files if names else ()):
            time_ns = round(index * 1e9 / self._rate)
            if not wanted(Label(TOPIC, index, time_ns, time_ns)):
                continue
            try:
                image = read_image(path)
            except FileProblem as error:
                self.skipped[TOPIC] += 1
                _log.warning('image %d of %s skipped: %s', index, self.path, error)
                continue
            header = factory.header(time_ns, FRAME_ID)
            yield BagFrame(TOPIC, index, time_ns, time_ns, FRAME_ID, image, header)


def image_files(folder: Path) -> list[Path]:
    """Return the images of a folder, ``live_9`` before ``live_10``."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    return sorted(found, key=by_number)
