"""Image files out."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from rsmb_ros.core.errors import FileProblem


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
