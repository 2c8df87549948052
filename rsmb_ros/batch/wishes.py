"""What an output is asked to be made of and with, so that it is known whether it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import rsmb_ros
from rsmb_ros.core import Config
from rsmb_ros.replay.selection import Selection

from .items import Item

DIGITS = 16  # of a digest; 64 bits: chance does not make two of a million equal


@dataclass(frozen=True)
class Wish:
    """What decides the content of the outputs of one recording."""

    version: str  # of rsmb_ros
    settings: Mapping[str, Any]  # what is not the default, by the name of its option or parameter
    digest: str  # of all settings, the defaults included
    input: Mapping[str, Any]  # bytes, and a digest of names, sizes and times of change


def wish_of(item: Item, selection: Selection, rate: float | None) -> Wish:
    """Return what is wished for an item now; files are looked at, not read."""
    files = [item.source]
    reference = item.reference
    if reference is not None and Path(reference).is_file():
        files.append(Path(reference))
        reference = str(Path(reference).resolve())  # the same one from whatever folder
    options = {'reference': reference, 'topic': item.topic, **asdict(selection), 'rate': rate}
    usual = {**dict.fromkeys(options), **asdict(Selection()), **Config().flat()}
    values = {**options, **item.config.flat()}
    return Wish(
        version=rsmb_ros.__version__,
        settings={name: value for name, value in values.items() if value != usual[name]},
        digest=_digest([json.dumps(values)]),
        input=_input(files),
    )


def differences(before: Wish, now: Wish) -> list[str]:
    """Say what is wished otherwise than before; nothing: the outputs would be the same."""
    told, usual = [], Config().flat()
    if before.version != now.version:
        told.append(f'rsmb_ros was {before.version}, is {now.version}')
    for name in sorted({*before.settings, *now.settings}):
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
