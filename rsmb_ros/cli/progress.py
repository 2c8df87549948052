"""How far long work is: a bar on a terminal, nothing in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import track

T = TypeVar('T')


def progress(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Iterate over `items`, of which there are `total`, showing how far it is."""
    if not sys.stderr.isatty():
        yield from items
    else:
        yield from track(items, what, total, console=Console(stderr=True), transient=True)
