"""The recordings of a batch: found in folders, each with a name of its own."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rsmb_ros.bags.image_folder import image_files
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError, ConfigError

BAGS = ('.mcap', '.db3', '.bag')
METADATA = 'metadata.yaml'  # makes a folder one recording of rosbag2
_NAME = re.compile(r'[\w][\w.-]*')


@dataclass(frozen=True)
class Item:
    """One recording of a batch, and what is special about it; see `ReplayJob`."""

    source: Path
    reference: str | None = None
    topic: str | None = None
    name: str | None = None  # of its outputs; None: made from that of the recording
    config: Config = field(default_factory=Config)


def found_in(path: Path, apart_from: Path) -> list[Path]:
    """
    Return the recordings that a path of the user stands for.

    A file is one, and so are a folder with metadata.yaml and one with images but no bag. Any other
    folder is searched, with all below it: each .mcap, .db3 and .bag is a recording of its own,
    because a folder of flights is met more often than a split recording that lost its
    metadata.yaml. Videos and folders of images are not searched for: they may be anything.

    Parameters
    ----------
    path : Path
        One that does not exist is returned: what fails is told when its turn comes.
    apart_from : Path
        Folder of the outputs, which are no inputs.

    Raises
    ------
    BagError
        If a folder holds no recording.

    """
    if not path.is_dir() or (path / METADATA).exists():
        return [path]
    found = list(_below(path, apart_from.resolve()))
    if found:
        return found
    if image_files(path):
        return [path]
    raise BagError(
        f'{path}: holds no recording: no {", ".join(BAGS)}, no folder with {METADATA}, no images; '
        'name a bag, or a folder with bags in it'
    )


def _below(folder: Path, apart_from: Path) -> Iterator[Path]:
    """Iterate over the bags in a folder, sorted, whatever the file system's order."""
    for place, folders, files in os.walk(folder):
        here = Path(place)
        if here.resolve() == apart_from:
            folders.clear()
        elif METADATA in files:
            folders.clear()
            yield here
        else:
            folders[:] = sorted(name for name in folders if not name.startswith('.'))
            for name in sorted(files):
                if not name.startswith('.') and Path(name).suffix in BAGS:
                    yield here / name


def without_doubles(items: Iterable[Item]) -> list[Item]:
    """Return the items in their order, each once, by whatever path it was named."""
    kept: dict[Item, Item] = {}
    for item in items:
        kept.setdefault(replace(item, source=item.source.resolve()), item)
    return list(kept.values())


def names_of(items: Sequence[Item], known: Mapping[Path, Sequence[str]]) -> list[str]:
    """
    Return a name for the outputs of each item; no two are equal, not even without case.

    Parameters
    ----------
    items : sequence of Item
    known : mapping of Path to sequence of str
        Names that recordings, by absolute path, have from an earlier batch: they keep them.

    Raises
    ------
    ConfigError
        If a name that is asked for cannot be one of a file, or is asked for twice.

    """
    names: dict[int, str] = {}
    taken: set[str] = set()

    def take(n: int, name: str) -> None:
        names[n] = name
        taken.add(name.casefold())

    for n, item in enumerate(items):
        if item.name is not None:
            if not _NAME.fullmatch(item.name):
                raise ConfigError(
                    f'{item.source}: name {item.name!r} must be of letters, digits, . _ and -, and '
                    'begin with a letter or digit'
                )
            if item.name.casefold() in taken:
                raise ConfigError(f'{item.source}: name {item.name!r} is taken; choose another one')
            take(n, item.name)
    before = {path: list(some) for path, some in known.items()}
    for n, item in enumerate(items):
        for name in before.get(item.source.resolve(), []) if n not in names else ():
            if name.casefold() not in taken:
                take(n, name)
                break
    # an old name that is not met today still is that of its outputs
    taken |= {name.casefold() for some in known.values() for name in some}
    _make_up(items, names, taken)
    return [names[n] for n in range(len(items))]


def _make_up(items: Sequence[Item], names: dict[int, str], taken: set[str]) -> None:
    """Name the others: by as many folders above them as tell them apart, else by numbers."""
    rest = [n for n in range(len(items)) if n not in names]
    paths = {n: items[n].source.resolve() for n in rest}
    for depth in range(max((len(path.parts) for path in paths.values()), default=0)):
        made = {n: _name(paths[n], depth) for n in rest}
        often = Counter(name.casefold() for name in made.values())
        for n, name in made.items():
            if often[name.casefold()] == 1 and name.casefold() not in taken:
                names[n] = name
                taken.add(name.casefold())
        rest = [n for n in rest if n not in names]
    for n in rest:
        base, number = _name(paths[n], 0), 1
        name = base
        while name.casefold() in taken:
            number += 1
            name = f'{base}-{number}'
        names[n] = name
        taken.add(name.casefold())


def _name(path: Path, depth: int) -> str:
    last = path.name if path.is_dir() else path.stem
    parts = [*path.parts[1:-1][-depth:], last] if depth else [last]
    return re.sub(r'[^\w.-]+', '_', '-'.join(parts)).lstrip('._-') or 'bag'
