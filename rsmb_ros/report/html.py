"""One HTML page that needs no network: numbers on top, pictures of frames below."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import cv2
import jinja2
import numpy as np

import rsmb_ros
from rsmb_ros.core.errors import FileProblem

from .drawing import to_bgr

FULL_FRAMES = 6  # shown with all their pictures
THUMBNAILS = 60  # frames shown small
OVERLAY_LEGEND = (
    'Red: changed, with the score. Green: static, at another depth than the ground. '
    'Dark and hatched: unknown.'
)
_PICTURE_COLS = 800  # px
_THUMBNAIL_COLS = 240  # px


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
    pictures: Mapping[str, str]  # caption -> data URI


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
            The last one is its thumbnail.

        """
        if index in self._full_at:
            uris = {name: _data_uri(image, _PICTURE_COLS) for name, image in pictures.items()}
            self._full.append(_Shown(title, text, uris))
        if index in self._small_at:
            name, image = list(pictures.items())[-1]
            self._small.append(_Shown(title, text, {name: _data_uri(image, _THUMBNAIL_COLS)}))

    def write(self, path: Path, summary: Mapping[str, str], tables: Sequence[Table] = ()) -> None:
        """Write the page; `summary` is the list of names and values on its top."""
        template = files('rsmb_ros.report').joinpath('templates/report.html.j2').read_text('utf-8')
        environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        page = environment.from_string(template).render(
            title=self._title,
            legend=self._legend,
            version=rsmb_ros.__version__,
            summary=summary,
            tables=tables,
            full=self._full,
            small=self._small,
        )
        try:
            path.write_text(page, 'utf-8')
        except OSError as error:
            raise FileProblem(f'{path}: cannot be written: {error.strerror}') from error


def evenly(total: int, wanted: int) -> frozenset[int]:
    """Return up to `wanted` numbers of 0 to total - 1, evenly spaced, the last one included."""
    if total <= wanted:
        return frozenset(range(total))
    return frozenset(np.rint(np.linspace(0, total - 1, wanted)).astype(int).tolist())


def _data_uri(image: np.ndarray, max_cols: int) -> str:
    if image.shape[1] > max_cols:
        rows = max(1, round(image.shape[0] * max_cols / image.shape[1]))
        image = cv2.resize(image, (max_cols, rows), interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode('.jpg', to_bgr(image), [cv2.IMWRITE_JPEG_QUALITY, 82])
    return 'data:image/jpeg;base64,' + base64.b64encode(jpeg.tobytes()).decode()
