"""
Which changes last: regions remembered at their places on the reference.

The camera moves, the reference does not: what is seen at one place of it again and again is an
object, what flickers is noise. Places are those on the background (relative depth 1); of what
stands above it they drift with the parallax, hence a region is compared with its last place.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .config import ChangeConfig
from .footprint import judged_at, on_reference, overlap
from .motion import CameraPath, Grid
from .segmentation import Blob

SAME = 0.3  # of a region that must lie where the remembered one lay: small ones jitter by 1-2 px
COVERED = 0.5  # of a remembered region that another one must cover for both to be seen
JUDGED = 0.75  # of a remembered region that must be judged before its absence counts
POINTS = 64  # of a remembered region that are looked up in a live frame, at most
MOST_REGIONS = 500  # remembered, those seen last


@dataclass(frozen=True)
class Known:
    """What is known of a confirmed region; fields as in `types.Region`."""

    id: int
    first_seen: int | None  # stamp [ns]
    reference_x: float  # [px]
    reference_y: float  # [px]


@dataclass
class _Track:
    """One remembered region."""

    place: Blob  # on the reference
    points: np.ndarray  # (n, 2) float64, x, y of some of its pixels
    first_seen: int | None  # stamp [ns]
    sightings: deque[bool]  # of the last frames that judged its place
    seen_at: int  # number of the frame
    id: int | None = None  # from when it is confirmed


@dataclass(frozen=True)
class _Pair:
    """How much a region of the frame and a remembered one have in common."""

    track: int  # index of the remembered one
    of_region: float  # common pixels, share of the frame's region
    of_track: float  # ... of the remembered one
    alike: float  # ... of both together (IoU)


class RegionMemory:
    """
    Remembers the changes of a stream against one reference, `MOST_REGIONS` at most.

    Parameters
    ----------
    config : ChangeConfig
        A region is confirmed by `persistence_seen` of the last `persistence_frames` frames that
        judged its place, the one it is seen in among them.

    """

    def __init__(self, config: ChangeConfig) -> None:
        self._seen, self._frames = config.persistence_seen, config.persistence_frames
        self._tracks: list[_Track] = []
        self._ids = 0
        self._now = 0

    def __len__(self) -> int:
        return len(self._tracks)

    @property
    def enabled(self) -> bool:
        """Whether anything is to be remembered."""
        return self._frames > 1

    def update(
        self,
        found: Sequence[Blob],
        path: CameraPath,
        judged: np.ndarray,
        stamp: int | None = None,
    ) -> list[Known | None]:
        """
        Take in one registered frame.

        A frame that does not judge the place of a remembered region says nothing about it.

        Parameters
        ----------
        found : sequence of Blob
            Changes of the live frame, apart from each other.
        path : CameraPath
            Where the frame lies on the reference.
        judged : ndarray of shape (M, N), bool
            Where the live frame was judged.
        stamp : int, optional
            When it was taken [ns].

        Returns
        -------
        list
            For each of `found` what is known of it, None where it is not confirmed (yet).

        """
        self._now += 1
        if not found and not self._tracks:
            return []
        homographies = path.row_homographies()
        places = [on_reference(blob, homographies, path.grid) for blob in found]
        pairs = [_pairs(place, self._tracks) for place in places]
        owners = _owners(pairs)
        self._count_others(owners, pairs, path.grid, homographies, judged)
        for n, track in owners.items():
            self._see_again(self._tracks[track], places[n], pairs[n])
        tracks = [
            self._tracks[owners[n]] if n in owners else self._new(place, pairs[n], stamp)
            for n, place in enumerate(places)
        ]
        self._tracks += [track for n, track in enumerate(tracks) if n not in owners]
        self._forget()
        return [self._known(track, place) for track, place in zip(tracks, places, strict=True)]

    def _count_others(
        self,
        owners: dict[int, int],
        pairs: list[list[_Pair]],
        grid: Grid,
        homographies: np.ndarray,
        judged: np.ndarray,
    ) -> None:
        """Say of what no region is taken for whether it was seen within another, or missed."""
        covered = {pair.track for near in pairs for pair in near if pair.of_track > COVERED}
        rest = [n for n in range(len(self._tracks)) if n not in set(owners.values())]
        for n in covered.intersection(rest):
            self._sight(self._tracks[n])
        missed = [self._tracks[n] for n in rest if n not in covered]
        if not missed:
            return
        points = np.concatenate([track.points for track in missed])
        known = judged_at(points, homographies, grid, judged)
        ends = np.cumsum([len(track.points) for track in missed])[:-1]
        for track, part in zip(missed, np.split(known, ends), strict=True):
            if part.mean() >= JUDGED:
                track.sightings.append(False)

    def _sight(self, track: _Track) -> None:
        track.sightings.append(True)
        track.seen_at = self._now

    def _see_again(self, track: _Track, place: Blob, near: list[_Pair]) -> None:
        """Remember a region at its new place, unless that is only a piece, or several regions."""
        self._sight(track)
        whole = [self._tracks[pair.track] for pair in near if pair.of_track > COVERED]
        if len(whole) == 1 and whole[0] is track:
            track.place, track.points = place, _some_points(place)

    def _new(self, place: Blob, near: list[_Pair], stamp: int | None) -> _Track:
        """Remember a region that was not there before, or that has come off another."""
        track = _Track(place, _some_points(place), stamp, deque([True], self._frames), self._now)
        part_of = next((pair.track for pair in near if pair.of_region > SAME), None)
        if part_of is not None:
            # one object now seen in two pieces: neither is new
            whole = self._tracks[part_of]
            track.first_seen = whole.first_seen
            track.sightings = whole.sightings.copy()
        return track

    def _known(self, track: _Track, place: Blob) -> Known | None:
        """Return what a region is known by, which gets its id when it is confirmed first."""
        if sum(track.sightings) < self._seen:
            return None
        if track.id is None:
            self._ids += 1
            track.id = self._ids
        rows, cols = np.nonzero(place.mask)
        return Known(
            track.id,
            track.first_seen,
            float(cols.mean() + place.x),
            float(rows.mean() + place.y),
        )

    def _forget(self) -> None:
        """Drop what the last frames did not show, and what was not seen for longest."""
        kept = [track for track in self._tracks if any(track.sightings)]
        kept.sort(key=lambda track: track.seen_at, reverse=True)
        self._tracks = kept[:MOST_REGIONS]


def _pairs(place: Blob, tracks: Sequence[_Track]) -> list[_Pair]:
    """Return the remembered regions that a place touches, the most alike first."""
    pairs = []
    for n, track in enumerate(tracks):
        common = overlap(place, track.place)
        if common:
            areas = place.area, track.place.area
            alike = common / (sum(areas) - common)
            pairs.append(_Pair(n, common / areas[0], common / areas[1], alike))
    return sorted(pairs, key=lambda pair: (-pair.alike, pair.track))


def _owners(pairs: list[list[_Pair]]) -> dict[int, int]:
    """Give each remembered region to one region at most, the most alike first: region -> track."""
    options = [
        (-pair.alike, n, pair.track)
        for n, near in enumerate(pairs)
        for pair in near
        if pair.of_region > SAME
    ]
    owners: dict[int, int] = {}
    for _, n, track in sorted(options):
        if n not in owners and track not in owners.values():
            owners[n] = track
    return owners


def _some_points(place: Blob) -> np.ndarray:
    """Return x, y of `POINTS` pixels of a place at most, evenly spread (n, 2) float64."""
    rows, cols = np.nonzero(place.mask)
    some = np.unique(np.linspace(0, len(rows) - 1, POINTS).round().astype(np.int64))
    return np.stack([cols[some] + place.x, rows[some] + place.y], axis=1).astype(np.float64)
