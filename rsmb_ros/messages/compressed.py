"""What a JPEG or PNG says of itself before it is decoded."""

from __future__ import annotations

import re
import struct

from .errors import MalformedMessage

_JPEG, _PNG = b'\xff\xd8\xff', b'\x89PNG\r\n\x1a\n'
_JPEG_END = b'\xff\xd9'

# What stands before, or between, the pixels is bounded: a file of nothing else would hold up
# the callback. Cameras write a dozen segments; libpng cuts pixels into chunks of 8 KiB.
_MOST_SEGMENTS = 1000
_MOST_CHUNKS = 1 << 16

# Start-of-frame markers; those between are tables (C4, C8, CC).
_START_OF_FRAME = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD8)}
_FILL = re.compile(b'\xff+')  # any number of them before a marker


def pixels_claimed(data: bytes, text: str) -> tuple[int, int]:
    """
    Return the rows and columns that a compressed image says it has.

    Parameters
    ----------
    data : bytes
        The file.
    text : str
        The message's format, for what is said of it.

    Raises
    ------
    MalformedMessage
        If it is neither JPEG nor PNG, its header cannot be read, or it is cut off: decoders fill
        the rest with grey, which would look like a change.

    """
    if data.startswith(_PNG):
        kind, size, complete = 'PNG', _size_in_png(data), _is_complete_png(data)
    elif data.startswith(_JPEG):
        kind, size, complete = 'JPEG', _size_in_jpeg(data), _JPEG_END in data
    else:
        kind, size, complete = '', None, True
    if kind and not complete:
        raise MalformedMessage(
            'short data', f'{kind} of format {text!r} is cut off: {len(data)} bytes without its end'
        )
    if size is None or 0 in size:
        raise MalformedMessage(
            'undecodable',
            f'{len(data)} bytes of format {text!r} cannot be decoded, must be a JPEG or PNG',
        )
    return size


def _size_in_png(data: bytes) -> tuple[int, int] | None:
    """Read the chunk IHDR, which must be the first one."""
    start = len(_PNG)
    if len(data) < start + 16 or data[start + 4 : start + 8] != b'IHDR':
        return None
    cols, rows = struct.unpack_from('>II', data, start + 8)
    return rows, cols


def _is_complete_png(data: bytes) -> bool:
    """
    Walk the chunks to the end of the picture.

    Each must lie in the file: OpenCV allocates what a chunk's length says, up to 4 GiB, before it
    notices.
    """
    at = len(_PNG)
    for _ in range(_MOST_CHUNKS):
        if len(data) < at + 12:
            return False
        (length,) = struct.unpack_from('>I', data, at)
        name = data[at + 4 : at + 8]
        at += 12 + length
        if name == b'IEND':
            return at <= len(data)
    return False


def _size_in_jpeg(data: bytes) -> tuple[int, int] | None:
    """Walk the segments up to the frame header; None if there is none where one must be."""
    at = 2
    for _ in range(_MOST_SEGMENTS):
        if run := _FILL.match(data, at):
            at = run.end() - 1
        if len(data) < at + 9 or data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker in _START_OF_FRAME:
            rows, cols = struct.unpack_from('>HH', data, at + 5)
            return rows, cols
        if marker in _WITHOUT_LENGTH:
            at += 2
        else:
            at += 2 + max(struct.unpack_from('>H', data, at + 2)[0], 2)
    return None
