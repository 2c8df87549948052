"""The records of an .mcap file, byte by byte: what of them can be trusted, and what is left."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from .damage import Unreadable

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')  # opcode, length of what follows
MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK = struct.Struct('<QQQI')  # start, end, uncompressed size, its CRC
_SIZE = struct.Struct('<Q')
_SLICE = 1 << 20  # compressed bytes that are taken at a time
MOST = 1 << 32  # bytes of one chunk; more is claimed only by damaged headers
# What parsing damaged bytes may raise.
BROKEN = (Unreadable, McapError, struct.error, ValueError, IndexError, EOFError)


class Chunk(NamedTuple):
    """Where one chunk lies, and what its data must be."""

    offset: int  # of the record in the file [byte]
    start_ns: int  # log time of its first message, or before
    data_at: int  # [byte]
    data_size: int  # [byte]
    size: int  # uncompressed [byte]
    crc: int  # of the uncompressed data, 0: there is none
    compression: str
    counts: dict[int, int] | None = None  # channel -> messages; None: not known

    @property
    def end(self) -> int:
        """Offset of the record that follows [byte]."""
        return self.data_at + self.data_size


def chunk_at(data: memoryview, offset: int) -> Chunk:
    """
    Return the chunk whose record starts at `offset`; its data may be cut off.

    Raises
    ------
    Unreadable
        If the lengths in the header contradict each other: it is no chunk, or a damaged one.

    """
    opcode, length = RECORD.unpack_from(data, offset)
    at = offset + RECORD.size
    start_ns, _, size, crc = _CHUNK.unpack_from(data, at)
    at += _CHUNK.size
    (name,) = struct.unpack_from('<I', data, at)
    at += 4
    if opcode != Opcode.CHUNK or name > 4 or size > MOST:
        raise Unreadable('its header is damaged')
    compression = bytes(data[at : at + name]).decode()
    at += name
    (data_size,) = _SIZE.unpack_from(data, at)
    at += _SIZE.size
    if at + data_size != offset + RECORD.size + length or compression not in _DECOMPRESSORS:
        raise Unreadable('its header is damaged')
    return Chunk(offset, start_ns, at, data_size, size, crc, compression)


def content(data: memoryview, chunk: Chunk) -> memoryview:
    """
    Return the records of a chunk, checked.

    Raises
    ------
    Unreadable
        If the data cannot be decompressed, or size or CRC is wrong.

    """
    raw, problem = _decompressed(data, chunk)
    if problem:
        raise Unreadable(problem)
    if len(raw) != chunk.size:
        raise Unreadable(f'{len(raw)} bytes, must be {chunk.size}')
    if chunk.crc and crc32(raw) != chunk.crc:
        raise Unreadable(f'CRC {crc32(raw):08x}, must be {chunk.crc:08x}')
    return memoryview(raw)


def beginning(data: memoryview, chunk: Chunk) -> memoryview:
    """Return as much of a chunk that is cut off as can be decompressed; nothing checks it."""
    return memoryview(_decompressed(data, chunk)[0])


def records(raw: memoryview) -> Iterator[tuple[int, memoryview, int]]:
    """Iterate over opcode, content and offset of the whole records in `raw`."""
    at = 0
    while at + RECORD.size <= len(raw):
        opcode, length = RECORD.unpack_from(raw, at)
        first = at + RECORD.size
        if first + length > len(raw):
            return
        yield opcode, raw[first : first + length], at
        at = first + length


def stream_of(raw: memoryview) -> ReadDataStream:
    """Return what the record classes of `mcap` read from."""
    return ReadDataStream(BytesIO(bytes(raw)))


def _decompressed(data: memoryview, chunk: Chunk) -> tuple[bytes, str]:
    """Return what could be decompressed and what went wrong then, '' if nothing did."""
    stored = data[chunk.data_at : chunk.data_at + chunk.data_size]
    if not chunk.compression:
        return bytes(stored), ''
    decompress = _DECOMPRESSORS[chunk.compression]()
    parts: list[bytes] = []
    total = 0
    try:
        for first in range(0, len(stored), _SLICE):
            parts.append(decompress(bytes(stored[first : first + _SLICE])))
            total += len(parts[-1])
            if total > chunk.size:
                return b''.join(parts), f'more than {chunk.size} bytes'
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError, MemoryError) as error:
        return b''.join(parts), f'{chunk.compression}: {error}'
    return b''.join(parts), ''


_DECOMPRESSORS = {
    '': lambda: bytes,
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj().decompress,
    'lz4': lambda: lz4.frame.LZ4FrameDecompressor().decompress,
}
