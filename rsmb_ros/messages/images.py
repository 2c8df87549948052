"""
sensor_msgs/Image and CompressedImage to arrays the detector takes.

Works on any object with the fields of the message: rclpy's and those of bag readers. Sizes are
checked against the data, and those inside a compressed file against a limit, before anything is
allocated: neither a lying header nor, given a limit, a decompression bomb costs anything.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from .compressed import pixels_claimed
from .errors import MalformedMessage

# Full scale to full scale: 65535 -> 255, rounded. A 12 bit camera that does not use the upper
# bits therefore comes out dark; nothing is stretched behind the user's back.
_TO_8_BIT = ((np.arange(65536, dtype=np.uint32) + 128) // 257).astype(np.uint8)


class _Encoding(NamedTuple):
    """How the pixels of one encoding lie in memory and how they become grey or BGR."""

    channels: int  # values per pixel in a row
    bits: int = 8  # per value
    code: int | None = None  # cv2.cvtColor code to BGR; None: the array is grey or BGR already
    even: bool = False  # chroma is shared by pairs of columns
    tall: bool = False  # M / 2 more rows with the chroma follow the M rows (planar)
    least: int = 1  # rows and columns; OpenCV turns a smaller mosaic silently black


_LEAST_MOSAIC = 3

# ROS names a mosaic by its first two pixels, OpenCV's old names by the second pair of row two.
_MOSAICS = {
    'bayer_rggb': cv2.COLOR_BayerBG2BGR,
    'bayer_bggr': cv2.COLOR_BayerRG2BGR,
    'bayer_gbrg': cv2.COLOR_BayerGR2BGR,
    'bayer_grbg': cv2.COLOR_BayerGB2BGR,
}

_ENCODINGS = {
    'mono8': _Encoding(1),
    '8UC1': _Encoding(1),
    'mono16': _Encoding(1, bits=16),
    '16UC1': _Encoding(1, bits=16),
    'bgr8': _Encoding(3),
    '8UC3': _Encoding(3),
    'rgb8': _Encoding(3, code=cv2.COLOR_RGB2BGR),
    'bgra8': _Encoding(4, code=cv2.COLOR_BGRA2BGR),
    'rgba8': _Encoding(4, code=cv2.COLOR_RGBA2BGR),
    **{
        f'{name}{bits}': _Encoding(1, bits=bits, code=code, least=_LEAST_MOSAIC)
        for bits in (8, 16)
        for name, code in _MOSAICS.items()
    },
    'yuv422_yuy2': _Encoding(2, code=cv2.COLOR_YUV2BGR_YUY2, even=True),
    'yuv422': _Encoding(2, code=cv2.COLOR_YUV2BGR_UYVY, even=True),
    'nv12': _Encoding(1, code=cv2.COLOR_YUV2BGR_NV12, even=True, tall=True),
}

KNOWN_ENCODINGS = tuple(_ENCODINGS)
_DEPTH_ENCODINGS = {'32FC1': _Encoding(1, bits=32), '16UC1': _Encoding(1, bits=16)}


def check_image(msg: Any, max_megapixels: float = math.inf) -> None:
    """
    Raise what `image_from_msg` would, without touching a pixel.

    Parameters
    ----------
    msg : sensor_msgs/Image
    max_megapixels : float
        Largest image that is taken [Mpx].

    Raises
    ------
    MalformedMessage
        If the encoding is unknown, a size is zero or above the limit, or `step` or the data is
        too short.

    """
    encoding = _ENCODINGS.get(msg.encoding)
    if encoding is None:
        raise MalformedMessage(
            'encoding', f'encoding is {msg.encoding!r}, known: {", ".join(KNOWN_ENCODINGS)}'
        )
    _check_layout(msg, encoding, max_megapixels)


def image_from_msg(msg: Any, max_megapixels: float = math.inf) -> np.ndarray:
    """
    Return the pixels of a sensor_msgs/Image; parameters and exceptions are `check_image`'s.

    Returns
    -------
    ndarray of shape (M, N) or (M, N, 3), uint8, C-contiguous and writable
        Grey or BGR. Shares the memory of ``msg.data`` where no conversion is needed. 16 bit
        becomes 8 bit by full scale: 65535 -> 255.

    """
    check_image(msg, max_megapixels)
    encoding = _ENCODINGS[msg.encoding]
    return _to_grey_or_bgr(_values(msg, encoding), encoding.code)


def check_compressed(msg: Any, max_megapixels: float = math.inf) -> None:
    """
    Raise what can be said against a sensor_msgs/CompressedImage without decoding it.

    Parameters
    ----------
    msg : sensor_msgs/CompressedImage
    max_megapixels : float
        Largest image that is taken [Mpx].

    Raises
    ------
    MalformedMessage
        If the data is empty, cut off, neither JPEG nor PNG, or claims more pixels than allowed.

    """
    data = np.frombuffer(msg.data, np.uint8)
    if not data.size:
        raise MalformedMessage('short data', f'compressed image ({msg.format!r}) has no data')
    rows, cols = pixels_claimed(data.tobytes(), msg.format)
    _check_pixels(f'{msg.format!r} image', rows, cols, max_megapixels)


def image_from_compressed(msg: Any, max_megapixels: float = math.inf) -> np.ndarray:
    """
    Return the pixels of a sensor_msgs/CompressedImage (JPEG or PNG).

    Parameters and exceptions are `check_compressed`'s; what turns out not to be decodable raises
    `MalformedMessage` as well.

    Returns
    -------
    ndarray of shape (M, N) or (M, N, 3), uint8
        Grey or BGR; in the sensor's orientation whatever EXIF says.

    """
    check_compressed(msg, max_megapixels)
    data = np.frombuffer(msg.data, np.uint8)
    try:
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:  # what the header's size did not tell
        pixels = None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise MalformedMessage(
            'undecodable',
            f'{data.size} bytes of format {msg.format!r} cannot be decoded, '
            'must be a JPEG or PNG of 8 or 16 bit',
        )
    code = _code_of_decoded(pixels, msg.format)
    if code in _MOSAICS.values() and min(pixels.shape) < _LEAST_MOSAIC:
        raise MalformedMessage(
            'size',
            f'{msg.format!r} image of {pixels.shape[0]} rows x {pixels.shape[1]} columns: both '
            f'must be at least {_LEAST_MOSAIC}',
        )
    return _to_grey_or_bgr(pixels, code)


def _check_pixels(what: str, rows: int, cols: int, max_megapixels: float) -> None:
    if rows * cols > max_megapixels * 1e6:
        raise MalformedMessage(
            'too large',
            f'{what} of {rows} rows x {cols} columns: {rows * cols / 1e6:.1f} Mpx, '
            f'worker.max_megapixels = {max_megapixels:g}',
        )


def _check_layout(msg: Any, encoding: _Encoding, max_megapixels: float) -> None:
    """Refuse sizes that do not fit together; nothing is allocated before this."""
    size = f'{msg.encoding} image of {msg.height} rows x {msg.width} columns'
    if min(msg.height, msg.width) < encoding.least:
        raise MalformedMessage('size', f'{size}: both must be at least {encoding.least}')
    if (encoding.even and msg.width % 2) or (encoding.tall and msg.height % 2):
        raise MalformedMessage('size', f'{size}: must be even, chroma is shared by pairs')
    row_bytes = msg.width * encoding.channels * encoding.bits // 8
    if msg.step < row_bytes:
        raise MalformedMessage(
            'short step', f'{size}: step is {msg.step} bytes, must be at least {row_bytes}'
        )
    needed = msg.step * _stored_rows(msg, encoding)
    if len(msg.data) < needed:
        raise MalformedMessage(
            'short data',
            f'{size}, step {msg.step}: data has {len(msg.data)} bytes, must have {needed}',
        )
    _check_pixels(f'{msg.encoding} image', msg.height, msg.width, max_megapixels)


def _stored_rows(msg: Any, encoding: _Encoding) -> int:
    return msg.height * 3 // 2 if encoding.tall else msg.height


def _values(msg: Any, encoding: _Encoding) -> np.ndarray:
    """Return the stored values, (rows, N) or (rows, N, channels), without the row padding."""
    rows = _stored_rows(msg, encoding)
    stored = np.frombuffer(msg.data, np.uint8, count=rows * msg.step).reshape(rows, msg.step)
    values = stored[:, : msg.width * encoding.channels * encoding.bits // 8]
    if encoding.bits > 8:
        kind = {16: 'u2', 32: 'f4'}[encoding.bits]
        values = values.view(f'{">" if msg.is_bigendian else "<"}{kind}')
    if encoding.channels > 1:
        values = values.reshape(rows, msg.width, encoding.channels)
    return values


def _to_grey_or_bgr(values: np.ndarray, code: int | None) -> np.ndarray:
    if values.dtype != np.uint8:
        values = _TO_8_BIT[values]
    if code is not None:
        return cv2.cvtColor(np.ascontiguousarray(values), code)
    # Writable: compiled kernels count a read-only array as another type and compile again.
    return np.require(values, requirements=('C', 'W'))


def _code_of_decoded(pixels: np.ndarray, text: str) -> int | None:
    """Return the cv2.cvtColor code for what imdecode returned; `text` is the message's format."""
    if pixels.ndim == 3:
        return cv2.COLOR_BGRA2BGR if pixels.shape[2] == 4 else None
    # A mosaic may travel as a grey PNG: 'bayer_rggb8; png compressed'.
    source = _ENCODINGS.get(text.partition(';')[0].strip())
    return source.code if source and text.startswith('bayer_') else None


def check_depth(msg: Any, max_megapixels: float = math.inf) -> None:
    """Raise what can be said against a depth image without touching a pixel; see below."""
    encoding = _DEPTH_ENCODINGS.get(msg.encoding)
    if encoding is None:
        known = ', '.join(_DEPTH_ENCODINGS)
        raise MalformedMessage('encoding', f'encoding is {msg.encoding!r}, of depth: {known}')
    _check_layout(msg, encoding, max_megapixels)


def depth_from_msg(msg: Any, max_megapixels: float = math.inf) -> np.ndarray:
    """
    Return the relative depth that a depth image tells (REP 118): 32FC1 [m] or 16UC1 [mm].

    Divided by its median, so that the background is 1 where it is what is mostly seen; depth that
    is relative already may come as 32FC1 as well.

    Returns
    -------
    ndarray of shape (M, N), float32
        NaN where there is no depth: 0, below 0 or not finite.

    Raises
    ------
    MalformedMessage
        If the encoding is another one, the data is too short, or there is no depth at all.

    """
    check_depth(msg, max_megapixels)
    depth = _values(msg, _DEPTH_ENCODINGS[msg.encoding]).astype(np.float32)
    depth[~(np.isfinite(depth) & (depth > 0.0))] = np.nan
    if np.isnan(depth).all():
        raise MalformedMessage('no depth', f'no pixel of {depth.shape} has a depth above 0')
    metres = depth.astype(np.float64)  # a sum or quotient of two float32 may be none
    relative = metres / np.float32(np.nanmedian(metres))
    with np.errstate(over='ignore', under='ignore'):
        depth = relative.astype(np.float32)
    depth[~(np.isfinite(depth) & (depth > 0.0))] = np.nan
    return depth
