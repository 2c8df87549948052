"""Pictures of one frame on one sheet."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from .drawing import captioned, to_bgr

_GAP = 6  # px between the pictures
_ACROSS = 2  # pictures in a row


def contact_sheet(pictures: Mapping[str, np.ndarray]) -> np.ndarray:
    """
    Join pictures, two in a row, each with its name above.

    Parameters
    ----------
    pictures : mapping of caption to ndarray of shape (M, N) or (M, N, 3), uint8
        Fitted into the size of the last one; a reference may have another size than the frames.

    Returns
    -------
    ndarray of shape (M', N', 3), uint8
        BGR.

    """
    shape = list(pictures.values())[-1].shape[:2]
    tiles = [captioned(_fitted(picture, shape), name) for name, picture in pictures.items()]
    white = (255, 255, 255)
    framed = [
        cv2.copyMakeBorder(tile, 0, _GAP, 0, _GAP, cv2.BORDER_CONSTANT, value=white)
        for tile in tiles
    ]
    framed += [np.full_like(framed[0], 255)] * (-len(framed) % _ACROSS)
    rows = [np.hstack(framed[n : n + _ACROSS]) for n in range(0, len(framed), _ACROSS)]
    return np.vstack(rows)[:-_GAP, :-_GAP]


def _fitted(picture: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Scale a picture into `shape` (rows, cols), grey where it has another aspect."""
    scale = min(shape[0] / picture.shape[0], shape[1] / picture.shape[1])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    fitted = np.full((*shape, 3), 128, np.uint8)
    scaled = to_bgr(picture)
    if scale != 1:
        scaled = cv2.resize(scaled, size, interpolation=cv2.INTER_AREA)
    fitted[: size[1], : size[0]] = scaled
    return fitted
