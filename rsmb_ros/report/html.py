"""One HTML page that needs no network: numbers on top, pictures of frames below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .page import write_page
from .pictures import Picture, encoded

FULL_FRAMES = 6  # shown with all their pictures
THUMBNAILS = 60  # frames shown small
OVERLAY_LEGEND = (
    'Red: changed, with the score. Green: static, at another depth than the ground. '
    'Dark and hatched: unknown.'
)
_PICTURE = 900, 200_000  # columns [px] and bytes of a JPEG
_THUMBNAIL = 240, 20_000


@dataclass(frozen=True)
class Table:
    """A table of the page; every cell is text."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class _Shown:
    title: str
    text: str
    pictures: Mapping[str, Picture]  # by caption


class Report:
    """
    Collects frames, then writes the page; keeps JPEGs only, so a long bag needs little memory.

    Parameters
    ----------
    title : str
    total : int
        Frames to come; `full` of them, evenly spaced, are shown with all their pictures.
    full : int
    legend : str
        Sentence above the pictures: what their colours mean.

    """

    def __init__(
        self, title: str, total: int, *, full: int = FULL_FRAMES, legend: str = OVERLAY_LEGEND
    ) -> None:
        self._title = title
        self._legend = legend
        self._full_at = evenly(total, full)
        self._small_at = evenly(total, THUMBNAILS)
        self._full: list[_Shown] = []
        self._small: list[_Shown] = []

    def wants(self, index: int) -> bool:
        """Return whether frame `index` will be shown: else spare yourself its pictures."""
        return index in self._full_at or index in self._small_at

    def add(self, index: int, title: str, text: str, pictures: Mapping[str, np.ndarray]) -> None:
        """
        Show a frame.

        Parameters
        ----------
        index : int
            0 to total - 1.
        title, text : str
            Its heading and a line below.
        pictures : mapping of caption to ndarray of shape (M, N) or (M, N, 3), uint8
            The last one is its thumbnail. 'live' and 'registered' are laid over each other, to be
            compared by swiping and blinking.

        """
        if index in self._full_at:
            shown = {name: encoded(image, *_PICTURE) for name, image in pictures.items()}
            self._full.append(_Shown(title, text, shown))
        if index in self._small_at:
            name, image = list(pictures.items())[-1]
            self._small.append(_Shown(title, text, {name: encoded(image, *_THUMBNAIL)}))

    def write(self, path: Path, summary: Mapping[str, str], tables: Sequence[Table] = ()) -> None:
        """Write the page; `summary` is the list of names and values on its top."""
        write_page(
            path,
            'report.html.j2',
            title=self._title,
            legend=self._legend,
            summary=summary,
            tables=tables,
            full=self._full,
            small=self._small,
        )


def evenly(total: int, wanted: int) -> frozenset[int]:
    """Return up to `wanted` numbers of 0 to total - 1, evenly spaced, the last one included."""
    if total <= wanted:
        return frozenset(range(total))
    return frozenset(np.rint(np.linspace(0, total - 1, wanted)).astype(int).tolist())
