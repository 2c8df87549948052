"""The recording that a path is, whatever its kind."""

from __future__ import annotations

from pathlib import Path

from rsmb_ros.core.errors import BagError, ConfigError

from . import image_folder, video
from .image_folder import ImageFolder, image_files
from .reading import FORMATS, Bag
from .recording import Recording
from .storage import storage_files
from .video import Video

KINDS = f'{FORMATS}, a video file or a folder of .png or .jpg images'


def open_recording(path: Path, rate: float | None = None) -> Recording:
    """
    Open a recording.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, .mcap, .db3, ROS 1 .bag, video file or folder of images.
    rate : float, optional
        Frames a second of a video or a folder, see there.

    Raises
    ------
    BagError
        If it is none of these, or damaged so that nothing can be read.
    ConfigError
        If there is a `rate` for a bag, which has stamps.

    """
    if not path.exists():
        raise BagError(f'{path}: no such file or folder; a recording is {KINDS}')
    if path.suffix.lower() in video.SUFFIXES and path.is_file():
        return Video(path, rate)
    if path.is_dir() and not (path / 'metadata.yaml').exists() and not storage_files(path):
        if not image_files(path):
            suffixes = ', '.join(image_folder.SUFFIXES)
            raise BagError(
                f'{path}: the folder has neither metadata.yaml, .mcap or .db3 of a bag '
                f'nor images ({suffixes}); a recording is {KINDS}'
            )
        return ImageFolder(path, rate)
    if rate is not None:
        raise ConfigError(f'--rate {rate:g}: {path} is a bag, whose frames have stamps; leave it')
    return Bag(path)
