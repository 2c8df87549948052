"""Image files in and out."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
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


def write_png(path: Path, image: np.ndarray) -> None:
    """Write a PNG; the name appears only when the file is complete."""
    _, data = cv2.imencode('.png', image)
    write_whole(path, data.tobytes())


def write_whole(path: Path, data: bytes) -> None:
    """Write a file; the name appears only when it is complete."""
    part = path.with_name(path.name + '.part')
    try:
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        raise FileProblem(f'{path}: cannot be written: {error.strerror}') from error


def output_folder(path: Path) -> Path:
    """Return `path`, made if needed."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileProblem(f'{path}: cannot be made a folder: {error.strerror}') from error
    return path
