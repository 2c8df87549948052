"""What a JPEG or PNG says of itself before it is decoded."""

from __future__ import annotations

import re
import struct

from .errors import MalformedMessage

_JPEG, _PNG = b'\xff\xd8\xff', b'\x89PNG\r\n\x1a\n'
_END_MARKERS = ((_JPEG, b'\xff\xd9', 'JPEG'), (_PNG, b'IEND', 'PNG'))

_PNG_SIZE_AT = 16  # after signature, chunk length and the name IHDR
# Start-of-frame markers; those between are tables (C4, C8, CC).
_START_OF_FRAME = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD8)}
_FILL = re.compile(b'\xff+')  # any number of them before a marker
_MOST_SEGMENTS = 1000  # before the frame; cameras write a dozen, a hostile file could hold millions


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
        If it is neither JPEG nor PNG, or its header cannot be read.

    """
    size = None
    if data.startswith(_PNG):
        size = _size_in_png(data)
    elif data.startswith(_JPEG):
        size = _size_in_jpeg(data)
    if size is None or 0 in size:
        raise MalformedMessage(
            'undecodable',
            f'{len(data)} bytes of format {text!r} cannot be decoded, must be a JPEG or PNG',
        )
    return size


def check_complete(data: bytes, text: str) -> None:
    """Refuse a cut-off file: decoders fill the rest with grey, which would look like a change."""
    for start, end, kind in _END_MARKERS:
        if data.startswith(start) and end not in data:
            raise MalformedMessage(
                'short data',
                f'{kind} of format {text!r} is cut off: {len(data)} bytes without its end marker',
            )


def _size_in_png(data: bytes) -> tuple[int, int] | None:
    if len(data) < _PNG_SIZE_AT + 8 or data[12:16] != b'IHDR':
        return None
    cols, rows = struct.unpack_from('>II', data, _PNG_SIZE_AT)
    return rows, cols


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
