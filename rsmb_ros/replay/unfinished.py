"""Outputs that were begun by an earlier replay: found, compared with the job, gone on with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rsmb_ros.bags.mcap_scan import scan
from rsmb_ros.bags.writing import METADATA, part_of
from rsmb_ros.core.config import Config, flatten
from rsmb_ros.core.errors import BagError, ConfigError

from .notes import said
from .stored import LeftByAnother, LeftDamaged, StoredFrames


def refuse_unfinished(output: Path) -> None:
    """
    Make sure that nothing is lost when a replay starts from nothing.

    Raises
    ------
    ConfigError
        If an earlier replay was killed before it was finished.

    """
    part = part_of(output)
    if not part.exists():
        return
    try:
        stored = _stored(part)
    except BagError:
        stored = None
    held = f'{len(stored)} frames' if stored else 'no whole frame'
    raise ConfigError(
        f'{part} is left of a recording that was not finished, with {held}; '
        f'go on with --resume, or delete it to start again'
    )


def unfinished(output: Path, wanted: Mapping[str, str]) -> StoredFrames | None:
    """
    Return what an earlier replay has left of `output`; None if there is nothing to go on with.

    That of a killed replay has the suffix ``.part``. One that was interrupted, or that is complete,
    has its name already, and loses it until it is finished again.

    Parameters
    ----------
    output : Path
    wanted : mapping of str to str
        What the new replay would note in its output.

    Raises
    ------
    LeftByAnother
        If it was made with another version, configuration, input or option; it is not touched.
    LeftDamaged
        If it is another kind of file.

    """
    part = part_of(output)
    place = part if part.exists() else output
    if not place.exists():
        return None
    try:
        stored = _stored(place)
    except BagError as error:
        raise LeftDamaged(str(error)) from error
    if stored is None:
        return None
    held = stored.scan.metadata.get(METADATA, {})
    if not set(wanted) & set(held) - {'version', 'config'}:
        raise LeftByAnother(f'--resume: {place} was not written by rsmb replay; choose another -o')
    differences = _differences(held, wanted)
    if differences:
        raise LeftByAnother(
            f'--resume: {place} was made otherwise: {"; ".join(differences)}; '
            'use the same again, or another -o'
        )
    if place is output:
        output.replace(part)
    return stored if len(stored) else None


def depends_on_earlier(config: Config) -> bool:
    """Return whether what is found in a frame depends on the frames before it."""
    return config.stream.hold or config.change.persistence_frames > 1


def _stored(path: Path) -> StoredFrames | None:
    found = scan(path)
    if found is None or not (found.metadata or found.chunks):
        return None  # killed before its first record
    # read later, under the name it then has
    return StoredFrames(path if path.suffix == '.part' else part_of(path), found)


def _differences(held: Mapping[str, str], wanted: Mapping[str, str]) -> list[str]:
    """Say what differs, in the order of what is wanted; parameters one by one."""
    before, now = said(held), said(wanted)
    flat_before, flat_now = flatten(before), flatten(now)
    names = [*flat_now, *(name for name in flat_before if name not in flat_now)]
    return [
        f'{name.removeprefix("config.")} was {flat_before.get(name)}, is {flat_now.get(name)}'
        for name in names
        if flat_before.get(name) != flat_now.get(name)
    ]
