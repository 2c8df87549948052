"""Pictures inside a page: JPEGs that never exceed the bytes they may take."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import cv2
import numpy as np

_QUALITIES = (84, 76, 68, 60, 50, 40)  # tried in this order
_SHRINK = 0.75  # of the size, where no quality is enough
_SMALLEST = 16  # px, below this a picture shows nothing


@dataclass(frozen=True)
class Picture:
    """One JPEG."""

    data: bytes
    width: int  # [px]
    height: int  # [px]

    @property
    def uri(self) -> str:
        """The picture as the `src` of an image that needs no network."""
        return 'data:image/jpeg;base64,' + base64.b64encode(self.data).decode()


def encoded(image: np.ndarray, most_cols: int, most_bytes: int) -> Picture:
    """
    Encode an image, as well as its bytes allow.

    Parameters
    ----------
    image : ndarray of shape (M, N) or (M, N, 3), uint8
        Grey or BGR.
    most_cols : int
        Wider ones are scaled down [px].
    most_bytes : int
        Of the JPEG; base64 makes it a third more.

    """
    scale = min(1.0, most_cols / image.shape[1])
    while True:
        shown = _scaled(image, scale)
        for quality in _QUALITIES:
            _, jpeg = cv2.imencode('.jpg', shown, [cv2.IMWRITE_JPEG_QUALITY, quality])
            if jpeg.size <= most_bytes or min(shown.shape[:2]) <= _SMALLEST:
                return Picture(jpeg.tobytes(), shown.shape[1], shown.shape[0])
        scale *= _SHRINK


@dataclass(frozen=True)
class Cut:
    """A rectangle inside an image."""

    left: int  # [px]
    top: int  # [px]
    width: int  # [px]
    height: int  # [px]

    def of(self, image: np.ndarray) -> np.ndarray:
        """Return the part of an image (M, N[, 3])."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


def cut_around(
    x: float, y: float, size: tuple[float, float], shape: tuple[int, int], least: int
) -> Cut:
    """
    Return a rectangle around a point, moved to lie inside the image.

    Parameters
    ----------
    x, y : float
        Its middle [px].
    size : (float, float)
        Wanted width and height [px].
    shape : (int, int)
        Rows and columns of the image.
    least : int
        Width and height, where the image has so many pixels [px].

    """
    rows, cols = shape
    width = min(max(round(size[0]), least), cols)
    height = min(max(round(size[1]), least), rows)
    left = min(max(round(x - width / 2), 0), cols - width)
    top = min(max(round(y - height / 2), 0), rows - height)
    return Cut(left, top, width, height)


def _scaled(image: np.ndarray, scale: float) -> np.ndarray:
    if scale >= 1.0:
        return image
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
