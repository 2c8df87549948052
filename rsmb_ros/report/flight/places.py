"""The same object in two hundred frames is one entry: regions grouped by place on the reference."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rsmb_ros.core.types import Region

from ..pictures import Picture
from .keeping import Thinned

SAME = 0.3  # share of the smaller box that two regions of one place have in common
STRIP = 6  # small pictures of one place, spread over its sightings
MOST_TRACKED = {'change': 120, 'static': 24}  # places of one kind and reference


@dataclass(frozen=True)
class Box:
    """A rectangle on the reference [px]."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def area(self) -> float:
        """Its pixels."""
        return (self.right - self.left) * (self.bottom - self.top)

    @property
    def middle(self) -> tuple[float, float]:
        """Its centre, x and y."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def shared_with(self, other: Box) -> float:
        """Return the share of the smaller of two boxes that the other one covers, 0..1."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        if width <= 0 or height <= 0:
            return 0.0
        return width * height / max(min(self.area, other.area), 1e-9)

    def united(self, other: Box) -> Box:
        """Return the box around two boxes."""
        return Box(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )

    @classmethod
    def around(cls, points: np.ndarray) -> Box | None:
        """Return the box of points (n, 2); None where they are not known."""
        if not np.isfinite(points).all():
            return None
        return cls(*points.min(axis=0).tolist(), *points.max(axis=0).tolist())


@dataclass(frozen=True)
class Views:
    """One sighting in pictures: parts of the three images, and where its outline is in them."""

    live: Picture
    registered: Picture
    reference: Picture | None  # None: not known where it lies
    size: tuple[int, int]  # width and height of what is shown of the frame [px]
    reference_size: tuple[int, int]  # ... of the reference [px]
    outline: str  # SVG path [px of the part]
    reference_outline: str
    unknown: str  # what of the part was not judged


@dataclass(frozen=True)
class Glimpse:
    """One sighting, small."""

    frame: int
    picture: Picture


@dataclass
class Place:
    """What was seen at one place."""

    kind: str  # as in `Region`
    reference: int  # number of the reference, from 0
    box: Box | None  # when it was seen last; None: not known
    first: int  # number of the first frame that showed it
    last: int  # ... of the last one
    best: Region  # the sighting with about the highest score, of several the largest
    best_frame: int
    score: float  # the highest
    frames: int = 1  # that showed it
    before: Box | None = None  # in the frame before the last one that showed it
    views: Views | None = None  # of the best sighting
    strip: Thinned[Glimpse] = field(default_factory=lambda: Thinned(STRIP))

    def meet(self, box: Box | None, frame: int) -> None:
        """Note a sighting; several pieces in one frame are one."""
        if frame != self.last:
            self.frames += 1
            self.last, self.before, self.box = frame, self.box, box or self.box
        elif box and self.box:
            self.box = self.box.united(box)

    def shared_with(self, box: Box) -> float:
        """Return the share that a box has in common with where this was seen lately, 0..1."""
        lately = [one for one in (self.before, self.box) if one]
        return max((box.shared_with(one) for one in lately), default=0.0)

    @property
    def importance(self) -> float:
        """Best score, halved for one frame, near to whole for many: a flicker counts less."""
        return self.score * (1.0 - 0.5**self.frames)


class PlaceBook:
    """All places of the regions of one kind."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._places: list[Place] = []
        self.dropped = 0  # places forgotten for more important ones

    def sight(self, region: Region, box: Box | None, reference: int, frame: int) -> Place | None:
        """
        Enter one region of a frame.

        Parameters
        ----------
        region : Region
            Of this book's kind.
        box : Box, optional
            On the reference.
        reference : int
            Number of the reference.
        frame : int
            Number of the frame.

        Returns
        -------
        Place or None
            Where it was entered; None: less important than all that can be remembered.

        """
        place = self._known(region, box, reference)
        if place is None:
            place = Place(self._kind, reference, box, frame, frame, region, frame, region.score)
            return place if self._enter(place) else None
        place.meet(box, frame)
        place.score = max(place.score, region.score)
        if _shown_well(region) > _shown_well(place.best):
            place.best, place.best_frame = region, frame
        return place

    def ranked(self) -> list[Place]:
        """Return the places, the most important first."""
        return sorted(self._places, key=lambda place: (-place.importance, place.first))

    def _known(self, region: Region, box: Box | None, reference: int) -> Place | None:
        here = [place for place in self._places if place.reference == reference]
        if region.id is not None:
            return next((place for place in here if place.best.id == region.id), None)
        if box is None:
            return None
        shared = [place.shared_with(box) for place in here]
        best = max(range(len(here)), key=lambda n: (shared[n], -n), default=None)
        return None if best is None or shared[best] < SAME else here[best]

    def _enter(self, place: Place) -> bool:
        """Remember a new place, unless the book is full of more important ones."""
        self._places.append(place)
        if len(self._places) <= MOST_TRACKED[self._kind]:
            return True
        least = min(self._places, key=lambda one: (one.importance, -one.first))
        self._places = [one for one in self._places if one is not least]
        self.dropped += 1
        return least is not place


def _shown_well(region: Region) -> tuple[float, int]:
    """Return what makes one sighting a better picture than another."""
    return round(region.score, 1), region.area
