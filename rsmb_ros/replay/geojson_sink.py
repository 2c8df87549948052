"""Changes as places on the earth: GeoJSON (RFC 7946)."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.recording import NAV_SAT_FIX, BagFrame
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.core.types import Region, Result
from rsmb_ros.messages.as_json import to_json

from .fixes import NoPlace, Track, fix_from_msg
from .ground import View
from .text_file import TextFile

COURSE = 'course'
ASSUMPTIONS = (
    'the camera looks straight down',
    'the ground is flat',
    'the lens does not distort and its axis hits the image centre',
    'camera and receiver are at one place, and their clocks agree',
    'the whole frame was taken at its stamp',
)
_log = logging.getLogger(__name__)
_END = '\n]}\n'
_DIGITS = 8  # of a degree: 1 mm


@dataclass(frozen=True)
class GeoOptions:
    """
    What a bag does not tell of the flight.

    Raises
    ------
    ConfigError
        If a value is missing or given twice.

    """

    path: Path
    heading: float | str | None = None  # of the image's upper edge [deg], or COURSE
    height: float | None = None  # above ground [m]
    ground_altitude: float | None = None  # above the ellipsoid [m]: the height is the fix's less it
    fix: str | None = None  # topic; None: the only one

    def __post_init__(self) -> None:
        if self.heading is None:
            raise ConfigError(
                "--geojson needs --heading: of the image's upper edge in degrees, clockwise from "
                'true north, or "course" where it points the way the drone flies'
            )
        if self.height is None and self.ground_altitude is None:
            raise ConfigError(
                '--geojson needs --height, in metres above the ground, or --ground-altitude, that '
                'of the ground above the WGS84 ellipsoid, which is taken from the altitude of '
                'the fixes'
            )
        if self.height is not None and self.ground_altitude is not None:
            raise ConfigError('--height and --ground-altitude both tell the height; give one')


@dataclass(frozen=True)
class Flight:
    """What a bag tells of the flight."""

    track: Track
    focal_px: float  # [px]
    width: int = 0  # of the images it is for [px]; 0: not told


class GeoJsonSink:
    """
    Writes one feature per change: the bounding box on the ground.

    A change of a frame whose place is not known has no geometry, and a property that says why.
    The file is whole after every frame.

    Parameters
    ----------
    options : GeoOptions
    flight : Flight

    """

    def __init__(self, options: GeoOptions, flight: Flight) -> None:
        self._options, self._flight = options, flight
        head = to_json({'type': 'FeatureCollection', 'assumptions': ASSUMPTIONS})
        self._file = TextFile(options.path, f'{head[:-1]}, "features": [{_END}')
        self._first = True
        self._unplaced: list[str] = []

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Write the changes of one frame."""
        if not result.changes:
            return
        try:
            view: View | str = self._view(frame)
        except NoPlace as reason:
            view = str(reason)
            self._unplaced.append(f'frame {frame.index}: {reason}')
        features = [self._feature(frame, region, view) for region in result.changes]
        text = ',\n'.join(map(to_json, features))
        self._file.write(f'{"" if self._first else ","}\n{text}{_END}', over=len(_END))
        self._first = False

    def close(self) -> None:
        """Close the file, and say what is not on the map."""
        self._file.close()
        if self._unplaced:
            count, first = len(self._unplaced), self._unplaced[0]
            _log.warning(
                '%s: %d frames with changes have no place: %s', self._options.path, count, first
            )

    def _view(self, frame: BagFrame) -> View:
        width, track = self._flight.width, self._flight.track
        if width not in (0, frame.image.shape[1]):
            raise NoPlace(
                f'camera_info is of images {width} px wide, the frame has '
                f'{frame.image.shape[1]} px: give --set camera.focal_px=VALUE'
            )
        given, fix = self._options, track.at(frame.stamp_ns)
        height, ground = given.height, given.ground_altitude
        if height is None:
            assert ground is not None
            height = fix.altitude - ground
            if not height > 0:
                raise NoPlace(
                    f'height {height:.1f} m: altitude of the fix {fix.altitude:.1f} m, '
                    f'of the ground {ground:g} m'
                )
        heading = given.heading
        turn = track.course(frame.stamp_ns) if heading == COURSE else float(heading or 0.0)
        return View(fix.latitude, fix.longitude, height, turn, ground or 0.0)

    def _feature(self, frame: BagFrame, region: Region, view: View | str) -> dict[str, Any]:
        properties = {
            'frame': frame.index,
            'stamp_ns': str(frame.stamp_ns),  # JavaScript's numbers cannot hold it
            'score': float(region.score),
            'kind': region.kind,
            'shadow_like': bool(region.shadow_like),
            'id': region.id,
            'area_px': int(region.area),
        }
        if isinstance(view, str):
            properties |= {'area_m2': None, 'no_place': view}
            return {'type': 'Feature', 'geometry': None, 'properties': properties}
        metres = view.height / self._flight.focal_px
        properties |= {
            'area_m2': round(region.area * metres**2, 4),
            'height_m': round(view.height, 3),
            'heading_deg': round(view.heading, 3),
        }
        corners = _corners(region)
        ring = view.positions(corners, frame.image.shape, self._flight.focal_px)
        places = [[round(x, _DIGITS), round(y, _DIGITS)] for x, y in (*ring, ring[0])]
        geometry = {'type': 'Polygon', 'coordinates': [places]}
        return {'type': 'Feature', 'geometry': geometry, 'properties': properties}


def flight_of(bag: Bag, options: GeoOptions, config: Config) -> Flight:
    """
    Read the flight of a bag.

    Raises
    ------
    BagError
        If the bag has no fix, or several topics of them.
    ConfigError
        If the focal length is not known.

    """
    lens = bag.intrinsics()
    focal_px = config.camera.focal_px or (lens.focal_px if lens else 0.0)
    if not focal_px:
        raise ConfigError(
            f'--geojson needs the focal length: {bag.path} has not one topic of '
            'sensor_msgs/CameraInfo that tells it; give --set camera.focal_px=VALUE'
        )
    if lens and lens.distorted:
        _log.warning('%s: camera_info tells of a lens that distorts: places are off', bag.path)
    topic = fix_topic(options, bag)
    track = Track(fix for fix in bag.each(topic, fix_from_msg) if fix)
    if not len(track):
        raise BagError(f'{bag.path}: --geojson: no message of {topic} has a fix')
    return Flight(track, focal_px, 0 if config.camera.focal_px or not lens else lens.width)


def fix_topic(options: GeoOptions, bag: Bag) -> str:
    """Return the name of the topic of fixes."""
    if options.fix:
        topic = bag.topic(options.fix)
        if topic.type != NAV_SAT_FIX:
            raise BagError(f'{bag.path}: --fix {topic.name} is {topic.type}, must be {NAV_SAT_FIX}')
        return topic.name
    found = [topic.name for topic in bag.topics if topic.type == NAV_SAT_FIX and topic.count]
    if len(found) != 1:
        problem = f'several topics ({", ".join(found)})' if found else 'no topic'
        remedy = 'give one with --fix TOPIC' if found else 'it cannot be placed on the earth'
        raise BagError(f'{bag.path}: --geojson: {problem} of {NAV_SAT_FIX}; {remedy}')
    return found[0]


def _corners(region: Region) -> np.ndarray:
    """Return the outer corners of the bounding box, counter-clockwise on the ground (4, 2)."""
    left, top = region.x - 0.5, region.y - 0.5
    right, bottom = left + region.width, top + region.height
    return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
