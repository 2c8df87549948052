"""Image files in."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from rsmb_ros.core.errors import FileProblem, FrameError
from rsmb_ros.messages.images import image_from_compressed


def read_image(path: Path) -> np.ndarray:
    """
    Return the pixels of an image file exactly as a CompressedImage with its bytes gives them.

    Returns
    -------
    ndarray of shape (M, N) or (M, N, 3), uint8
        Grey or BGR, in the sensor's orientation whatever EXIF says.

    Raises
    ------
    FileProblem
        If the file is missing or not an image.

    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileProblem(f'{path}: cannot be read: {error.strerror}') from error
    try:
        return image_from_compressed(SimpleNamespace(data=data, format=path.suffix.lstrip('.')))
    except FrameError as error:
        raise FileProblem(f'{path}: not an image: {error}') from error
