"""
A flight on one page: what changed, where, when, and what could not be judged.

Nobody knows at a frame how many will follow. What is kept is therefore decided frame by frame, and
bounded: pictures of some dozen frames and places, and a line of numbers for every frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.config import Config
from rsmb_ros.core.types import Region, Result

from ..page import write_page
from ..pictures import Picture, encoded
from .contents import page_of
from .ground import Coverage, Ground, focal_of
from .keeping import Highest, Thinned
from .places import Box, Glimpse, PlaceBook
from .records import FrameRecord, record_of
from .shown import GLIMPSE, Mark, ShownFrame, cut_of, shown_frame, views_of

# Frames with pictures: those with the most change, not registered ones, evenly spaced ones.
MOST_CHANGED, MOST_LOST, MOST_EVEN = 12, 6, 12
MOST_REFERENCES = 4  # with a map; of more, the first
REFERENCE = 1000, 180_000  # columns [px] and bytes of its JPEG


@dataclass
class Sheet:
    """One reference."""

    image: np.ndarray  # the last one's only: the others are not needed any more
    shape: tuple[int, int]  # rows, columns [px]
    picture: Picture | None  # None: one of too many
    coverage: Coverage | None
    frames: int = 0


class FlightReport:
    """
    Collects the frames of a flight in their order, then writes the page.

    Equal frames give an equal page: nothing in it depends on the clock or on the machine.

    Parameters
    ----------
    title : str
    config : Config
        The frames were judged with.
    camera : Camera, optional
        Given to the `Detector`.

    """

    def __init__(self, title: str, config: Config = Config(), camera: Camera | None = None) -> None:
        self.title = title
        self.config = config
        self._camera = camera
        self.records: list[FrameRecord] = []
        self.sheets: list[Sheet] = []
        self.books = {kind: PlaceBook(kind) for kind in ('change', 'static')}
        self._changed: Highest[ShownFrame] = Highest(MOST_CHANGED)
        self._lost: Thinned[ShownFrame] = Thinned(MOST_LOST)
        self._even: Thinned[ShownFrame] = Thinned(MOST_EVEN)

    def add(
        self,
        index: int,
        time_ns: int,
        live: np.ndarray,
        reference: np.ndarray,
        result: Result,
    ) -> None:
        """
        Take one frame; costs little, and more when pictures of it are kept.

        Parameters
        ----------
        index : int
            Its number in the recording, above that of the frame before.
        time_ns : int
            Its stamp.
        live, reference : ndarray of shape (M, N[, 3]) and (M', N'[, 3]), uint8
            Grey or BGR.
        result : Result

        """
        result = _as_stored(result)
        record = record_of(index, time_ns, result)
        self.records.append(record)
        sheet = self._sheet_of(reference)
        sheet.frames += 1
        marks: list[Mark] = []
        if record.registered:
            focal_px = focal_of(self.config, self._camera, live.shape[1])
            ground = Ground(result, sheet.shape, focal_px)
            if sheet.coverage:
                sheet.coverage.add(ground, result.valid_mask)
            marks = [self._entered(one, index, live, result, ground) for one in result.regions]
        self._keep(record, live, result, marks)

    def frames(self) -> list[ShownFrame]:
        """Return the frames with pictures, in their order."""
        kept = {one.record.index: one for one in chain(self._changed, self._lost, self._even)}
        return [kept[index] for index in sorted(kept)]

    def write(
        self, path: Path, facts: Mapping[str, str] | None = None, warnings: Sequence[str] = ()
    ) -> None:
        """
        Write the page.

        Parameters
        ----------
        path : Path
        facts : mapping of str to str, optional
            Names and values that only the caller knows, such as the recording.
        warnings : sequence of str
            Sentences on what is missing, shown on top.

        Raises
        ------
        FileProblem
            If it cannot be written.

        """
        write_page(path, 'flight.html.j2', **page_of(self, facts or {}, warnings))

    def _sheet_of(self, reference: np.ndarray) -> Sheet:
        """Return the sheet of a reference; it is a new one when its pixels are."""
        last = self.sheets[-1].image if self.sheets else None
        if last is None or not (reference is last or np.array_equal(reference, last)):
            shown = len(self.sheets) < MOST_REFERENCES
            picture = encoded(reference, *REFERENCE) if shown else None
            shape = (reference.shape[0], reference.shape[1])
            coverage = Coverage(shape) if shown else None
            if self.sheets:
                self.sheets[-1].image = np.empty(0, np.uint8)
            self.sheets.append(Sheet(reference, shape, picture, coverage))
        return self.sheets[-1]

    def _entered(
        self, region: Region, index: int, live: np.ndarray, result: Result, ground: Ground
    ) -> Mark:
        """Enter a region of this frame into its book, with pictures when it is the best so far."""
        book, number = self.books[region.kind], len(self.sheets) - 1
        place = book.sight(region, Box.around(_corners(region, ground)), number, index)
        if place is None:
            return Mark(region, None)
        if place.best is region:
            place.views = views_of(region, live, self.sheets[-1].image, result, ground)
        cut = cut_of(region, (live.shape[0], live.shape[1]))
        place.strip.offer(lambda: Glimpse(index, encoded(cut.of(live), *GLIMPSE)))
        return Mark(region, place)

    def _keep(
        self, record: FrameRecord, live: np.ndarray, result: Result, marks: Sequence[Mark]
    ) -> None:
        made: list[ShownFrame] = []

        def make() -> ShownFrame:
            if not made:
                made.append(shown_frame(record, len(self.sheets) - 1, live, result, marks))
            return made[0]

        self._even.offer(make)
        if not record.registered:
            self._lost.offer(make)
        if record.changes:
            self._changed.offer(_interest(record, marks), make)


def _interest(record: FrameRecord, marks: Sequence[Mark]) -> float:
    """Return the scores of a frame's changes; those seen for the first time count twice."""
    changes = [mark for mark in marks if mark.region.kind == 'change']
    fresh = [one for one in changes if one.place and one.place.first == record.index]
    return sum(mark.region.score for mark in (*changes, *fresh))


def _corners(region: Region, ground: Ground) -> np.ndarray:
    """Return the corners of a region's box on the reference (4, 2) [px]."""
    right, bottom = region.x + region.width - 1, region.y + region.height - 1
    corners = [(region.x, region.y), (right, region.y), (region.x, bottom), (right, bottom)]
    return ground.on_reference(np.array(corners, np.float64))


def _as_stored(result: Result) -> Result:
    """Return a result as its messages keep it: a page made of stored ones is the same."""
    rows = {
        name: getattr(result, name).astype(np.float32).astype(np.float64)
        for name in ('row_motion', 'row_uncertainty')
    }
    return replace(result, **rows)
