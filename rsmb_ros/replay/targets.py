"""Whether the files of a job can be written: known before the work begins."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from rsmb_ros.core.errors import ConfigError, FileProblem


def check_targets(targets: Mapping[str, Path], inputs: Mapping[str, Path]) -> None:
    """
    Make sure that every output can be written, and that none replaces an input or another output.

    Parameters
    ----------
    targets, inputs : mapping of str to Path
        By what they are called in a message: ``--csv``; inputs may be folders.

    Raises
    ------
    ConfigError
        If an output is an input, lies in a folder that is one, or is another output.
    FileProblem
        If its folder does not exist or may not be written, or there is a folder of its name.

    """
    taken: dict[Path, str] = {}
    for name, path in targets.items():
        full = path.resolve()
        for other, source in inputs.items():
            if _is_part_of(full, source.resolve()):
                raise ConfigError(f'{name} {path} is {other} to be read; choose another name')
        if full in taken:
            raise ConfigError(f'{name} {path} is also that of {taken[full]}; choose another name')
        taken[full] = name
        _check_writable(path)


def paths_named(reference: str) -> list[Path]:
    """Return what exists of the paths in ``FILE``, ``FILE@WHICH`` or ``FILE:TOPIC@WHICH``."""
    where = reference.rpartition('@')[0]
    names = (reference, where, where.rpartition(':')[0])
    return [Path(name) for name in names if name and Path(name).exists()]


def _is_part_of(target: Path, source: Path) -> bool:
    if target == source:
        return True
    return target.exists() and source.is_dir() and source in target.parents


def _check_writable(path: Path) -> None:
    problem = f'{path}: cannot be written: '
    folder = path.parent
    if not folder.exists():
        raise FileProblem(f'{problem}there is no folder {folder}; create it first')
    if not folder.is_dir():
        raise FileProblem(f'{problem}{folder} is no folder')
    if path.is_dir():
        raise FileProblem(f'{problem}it is a folder; name a file')
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise FileProblem(f'{problem}permission denied')
