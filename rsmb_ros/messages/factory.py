"""How results become messages, without naming the library that owns the message classes."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np


class MessageFactory(Protocol):
    """Builds messages of one library (rclpy, or a bag's type store) with equal contents."""

    def image(self, header: Any, array: np.ndarray) -> Any:
        """Return a sensor_msgs/Image; `array` as in `image_fields`."""

    def text(self, text: str) -> Any:
        """Return a std_msgs/String."""

    def rows(self, array: np.ndarray, labels: tuple[str, ...]) -> Any:
        """Return a std_msgs/Float32MultiArray; one label per axis, outermost first."""


class ImageFields(NamedTuple):
    """Fields of a sensor_msgs/Image beside its header, named alike."""

    height: int  # [px]
    width: int  # [px]
    encoding: str
    is_bigendian: int
    step: int  # bytes per row
    data: np.ndarray  # (height * step,) uint8; each library wants another container


class RowsFields(NamedTuple):
    """Content of a std_msgs/Float32MultiArray."""

    dimensions: tuple[tuple[str, int, int], ...]  # label, size, stride (elements), outermost first
    data: np.ndarray  # flat float32, row-major


_ENCODING_OF = {(np.uint8, 2): 'mono8', (np.uint8, 3): 'bgr8', (np.float32, 2): '32FC1'}


def image_fields(array: np.ndarray) -> ImageFields:
    """
    Return the fields of an Image with the pixels of `array`.

    Parameters
    ----------
    array : ndarray of shape (M, N) uint8 -> mono8, (M, N, 3) uint8 BGR -> bgr8,
        (M, N) float32 -> 32FC1 little-endian

    """
    encoding = _ENCODING_OF[array.dtype.type, array.ndim]
    stored = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder('<'))
    data = stored.reshape(-1).view(np.uint8)
    height, width = array.shape[:2]
    return ImageFields(height, width, encoding, 0, data.size // height, data)


def rows_fields(array: np.ndarray, labels: tuple[str, ...]) -> RowsFields:
    """Return `array` flattened to float32 with one labelled dimension per axis."""
    # Stride as std_msgs defines it: elements from this dimension inwards, itself included.
    strides = [int(np.prod(array.shape[axis:])) for axis in range(array.ndim)]
    dimensions = tuple(zip(labels, array.shape, strides, strict=True))
    return RowsFields(dimensions, np.ascontiguousarray(array, np.float32).reshape(-1))
