"""What an output is asked to be made of and with, so that it is known whether it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import rsmb_ros
from rsmb_ros.core import Config
from rsmb_ros.replay.geojson_sink import GeoOptions
from rsmb_ros.replay.selection import Selection

from .items import Item

# Options of the map alone: of its content, not of the frames'.
OF_MAP = tuple(one.name for one in fields(GeoOptions) if one.name != 'path')
DIGITS = 16  # of a digest; 64 bits: chance does not make two of a million equal


@dataclass(frozen=True)
class Wish:
    """What decides the content of the outputs of one recording."""

    version: str  # of rsmb_ros
    settings: Mapping[str, Any]  # what is not the default, by the name of its option or parameter
    digest: str  # of frames and parameters, the defaults included
    input: Mapping[str, Any]  # bytes, and a digest of names, sizes and times of change


@dataclass(frozen=True)
class Content:
    """What all outputs of a batch are wished to hold; see `ReplayJob`."""

    selection: Selection = field(default_factory=Selection)
    rate: float | None = None
    compress: str | None = None
    keep_input: bool = False
    geo: GeoOptions | None = None  # of every map but for its path

    def special(self) -> dict[str, Any]:
        """Return the options of the outputs that are not the default, by name."""
        given = {'compress': self.compress, 'keep_input': self.keep_input or None}
        given |= {name: getattr(self.geo, name, None) for name in OF_MAP}
        return {name: value for name, value in given.items() if value is not None}


def wish_of(item: Item, content: Content) -> Wish:
    """Return what is wished for an item now; files are looked at, not read."""
    files = [item.source]
    reference = item.reference
    if reference is not None and Path(reference).is_file():
        files.append(Path(reference))
        reference = str(Path(reference).resolve())  # the same one from whatever folder
    picked = {**asdict(content.selection), 'rate': content.rate}
    options = {'reference': reference, 'topic': item.topic, **picked}
    usual = {**dict.fromkeys(options), **asdict(Selection()), **Config().flat()}
    values = {**options, **item.config.flat()}
    changed = {name: value for name, value in values.items() if value != usual[name]}
    return Wish(
        version=rsmb_ros.__version__,
        settings=changed | content.special(),
        digest=_digest([json.dumps(values)]),
        input=_input(files),
    )


def differences(before: Wish, now: Wish, but: Collection[str] = ()) -> list[str]:
    """
    Say what is wished otherwise than before; nothing: the outputs would be the same.

    Settings in `but` do not matter.
    """
    told, usual = [], Config().flat()
    if before.version != now.version:
        told.append(f'rsmb_ros was {before.version}, is {now.version}')
    for name in sorted({*before.settings, *now.settings} - {*but}):
        was, asked = (
            side.settings.get(name, usual.get(name, 'not given')) for side in (before, now)
        )
        if was != asked:
            told.append(f'{name} was {was}, is {asked}')
    if not told and before.digest != now.digest:
        told.append('the settings were others')
    if before.input != now.input:
        told.append('the input was changed')
    return told


def _input(paths: list[Path]) -> dict[str, Any]:
    size, lines = 0, []
    for path in paths:
        for file in _files(path):
            stat = file.stat()
            size += stat.st_size
            name = file.relative_to(path) if path.is_dir() else path.name
            lines.append(f'{name} {stat.st_size} {stat.st_mtime_ns}')
    return {'bytes': size, 'digest': _digest(lines)}


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(one for one in path.rglob('*') if one.is_file())
    elif path.is_file():
        yield path


def _digest(lines: list[str]) -> str:
    return hashlib.sha256('\n'.join(lines).encode()).hexdigest()[:DIGITS]
