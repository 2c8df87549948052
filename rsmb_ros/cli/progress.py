"""How far long work is: a bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, track

T = TypeVar('T')


def progress(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Iterate over `items`, of which there are `total`, showing how far it is."""
    if not sys.stderr.isatty():
        yield from items
    else:
        yield from track(items, what, total, console=Console(stderr=True), transient=True)


def narrated(items: Iterable[T | str], total: int, what: str) -> Iterator[T]:
    """
    Iterate over `items`, of which there are `total`; a text among them says what is done next.

    The line is drawn between items only: no thread takes time from what is measured.
    """
    if not sys.stderr.isatty():  # a bar that is disabled ends with an empty line (rich 13)
        yield from (item for item in items if not isinstance(item, str))
        return
    console = Console(stderr=True)
    columns = (TextColumn('{task.description}'), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task(what, total=total)
        for item in items:
            if isinstance(item, str):
                bar.update(task, description=f'{what}: {item}', refresh=True)
            else:
                yield item
                bar.update(task, advance=1, refresh=True)
