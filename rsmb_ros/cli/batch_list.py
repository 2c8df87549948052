"""Lists of recordings for `rsmb batch --manifest`."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from rsmb_ros.batch.items import Item
from rsmb_ros.core.config import flatten
from rsmb_ros.core.errors import ConfigError, FileProblem

from .options import parse_yaml

_PLAIN = ('bag', 'reference', 'topic', 'name')
_KEYS = (*_PLAIN, 'config')


def read_list(path: Path, common: Item) -> list[Item]:
    """
    Return the recordings of a list.

    Parameters
    ----------
    path : Path
        YAML: a list of mappings with ``bag`` and, where it is special, ``reference``, ``topic``,
        ``name`` of the outputs and ``config``, parameters as in a file for ``--config``. CSV: the
        same as columns, each parameter one of its own (``change.threshold_high``); what is empty
        is not special. Files are relative to the folder of the list.
    common : Item
        What holds for those that say nothing else.

    Raises
    ------
    FileProblem
        If the file cannot be read.
    ConfigError
        If it is no such list, or a key or value is not allowed; says which entry.

    """
    try:
        text = path.read_text('utf-8-sig')  # spreadsheets like to begin with a mark
    except OSError as error:
        raise FileProblem(f'--manifest {path}: cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise ConfigError(f'--manifest {path}: is no text in UTF-8') from error
    entries = _rows(path, text) if path.suffix.lower() == '.csv' else _mappings(path, text)
    items = []
    for n, entry in enumerate(entries, 1):
        try:
            items.append(_item(path.parent, entry, common))
        except ConfigError as error:
            raise ConfigError(f'--manifest {path}: recording {n}: {error}') from error
    return items


def beside(folder: Path, reference: str | None) -> str | None:
    """Return a reference of ``--reference`` whose file, if it names one, lies in `folder`."""
    if reference is None:
        return None
    whole, before_at = reference, reference.rpartition('@')[0]
    for file in (whole, before_at, before_at.rpartition(':')[0]):
        if file and (folder / file).exists():
            return str(folder / file) + reference[len(file) :]
    return reference


def _mappings(path: Path, text: str) -> list[Mapping[str, Any]]:
    try:
        content = parse_yaml(text)
    except yaml.YAMLError as error:
        raise ConfigError(f'--manifest {path}: not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(content, list) or not all(isinstance(one, Mapping) for one in content):
        raise ConfigError(f'--manifest {path}: must hold a list, each entry like "- bag: FILE"')
    return content


def _rows(path: Path, text: str) -> list[Mapping[str, Any]]:
    table = csv.DictReader(text.splitlines())
    entries: list[Mapping[str, Any]] = []
    for row in table:
        if None in row or None in row.values():
            raise ConfigError(
                f'--manifest {path}: line {table.line_num} has another number of columns than '
                'the first one'
            )
        given = {name.strip(): value.strip() for name, value in row.items() if value.strip()}
        special = {name: _value(value) for name, value in given.items() if name not in _PLAIN}
        plain = {name: value for name, value in given.items() if name in _PLAIN}
        entries.append({**plain, 'config': special} if special else plain)
    return entries


def _value(text: str) -> Any:
    try:
        return parse_yaml(text)
    except yaml.YAMLError:
        return text  # refused where the parameter is known


def _item(folder: Path, entry: Mapping[str, Any], common: Item) -> Item:
    for key in entry:
        if key not in _KEYS:
            raise ConfigError(f'{key!r} is unknown; must be one of {", ".join(_KEYS)}')
    given = {key: entry[key] for key in _PLAIN if entry.get(key) is not None}
    for key, value in given.items():
        if not isinstance(value, str):
            raise ConfigError(
                f'{key} = {value!r} is a {type(value).__name__}, must be a text; quote it'
            )
    if not given.get('bag'):
        raise ConfigError('bag is missing: the file or folder to be read')
    config = entry.get('config') or {}
    if not isinstance(config, Mapping):
        raise ConfigError(
            f'config = {config!r} must hold parameters: config: {{SECTION.KEY: VALUE}}'
        )
    return replace(
        common,
        source=folder / given['bag'],
        reference=beside(folder, given.get('reference')) or common.reference,
        topic=given.get('topic', common.topic),
        name=given.get('name'),
        config=common.config.replaced(flatten(config)),
    )
