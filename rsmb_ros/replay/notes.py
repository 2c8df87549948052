"""What an output says of the replay that made it: enough to know whether it can be gone on with."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rsmb_ros.bags.recording import Topic

_END_BYTES = 1 << 20  # of a file that are looked at, at each end


def input_notes(source: Path) -> dict[str, Any]:
    """Return name, size [bytes] and fingerprint of a file or folder, wherever it lies."""
    files = list(_files(source))
    digest = hashlib.sha256()
    size = 0
    for path in files:
        length = path.stat().st_size
        name = path.relative_to(source).as_posix() if source.is_dir() else ''
        digest.update(f'{name}\0{length}\0'.encode())
        with path.open('rb') as stream:
            digest.update(stream.read(_END_BYTES))
            stream.seek(max(_END_BYTES, length - _END_BYTES))
            digest.update(stream.read(_END_BYTES))
        size += length
    return {'name': source.name, 'bytes': size, 'fingerprint': digest.hexdigest()[:16]}


def image_notes(image: np.ndarray | Topic | None) -> str | None:
    """Return the name of a topic, or the fingerprint of an array."""
    if image is None or isinstance(image, Topic):
        return None if image is None else image.name
    kind = f'{image.dtype} {image.shape} '
    return kind + hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()[:16]


def noted(values: Mapping[str, Any]) -> dict[str, str]:
    """Return values as the texts that a metadata record can hold."""
    return {name: json.dumps(value, allow_nan=False) for name, value in values.items()}


def said(notes: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of a metadata record; what is no JSON is a text."""
    return {name: _value(text) for name, text in notes.items()}


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def _files(source: Path) -> Iterator[Path]:
    if source.is_dir():
        yield from sorted(path for path in source.rglob('*') if path.is_file())
    else:
        yield source
