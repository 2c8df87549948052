"""Pictures of one frame side by side."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from .drawing import captioned, to_bgr

_GAP = 6  # px between the pictures


def side_by_side(pictures: Mapping[str, np.ndarray]) -> np.ndarray:
    """
    Join pictures into one row, each with its name above.

    Parameters
    ----------
    pictures : mapping of caption to ndarray of shape (M, N) or (M, N, 3), uint8
        Scaled to the height of the last one; a reference may have another size than the frames.

    Returns
    -------
    ndarray of shape (M', N', 3), uint8
        BGR.

    """
    rows = list(pictures.values())[-1].shape[0]
    tiles = [captioned(_with_rows(picture, rows), name) for name, picture in pictures.items()]
    height = max(tile.shape[0] for tile in tiles)
    white = (255, 255, 255)
    framed = [
        cv2.copyMakeBorder(
            tile, 0, height - tile.shape[0], 0, _GAP, cv2.BORDER_CONSTANT, value=white
        )
        for tile in tiles
    ]
    return np.hstack(framed)[:, :-_GAP]


def _with_rows(picture: np.ndarray, rows: int) -> np.ndarray:
    if picture.shape[0] == rows:
        return to_bgr(picture)
    cols = round(picture.shape[1] * rows / picture.shape[0])
    return cv2.resize(to_bgr(picture), (cols, rows), interpolation=cv2.INTER_AREA)
