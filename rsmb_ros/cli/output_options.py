"""Options of `rsmb replay` and `rsmb batch`: what they write."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from rsmb_ros.core.errors import ConfigError
from rsmb_ros.replay.geojson_sink import COURSE, GeoOptions
from rsmb_ros.replay.recorded import JPEG, PNG

from .options import mcap_path

GEOJSON = (
    'changes on the map, from sensor_msgs/NavSatFix: the camera looks straight down on flat ground'
)


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """Add ``-o``, ``--csv`` and all the others."""
    files = parser.add_argument_group('outputs')
    files.add_argument(
        '-o',
        '--output',
        type=mcap_path,
        metavar='OUT.mcap',
        help='everything the node would publish, under /rsmb/; needed unless --check',
    )
    add_content_options(files, 'OUT.mcap')
    files.add_argument(
        '--resume',
        action='store_true',
        help='go on with OUT.mcap of a replay that was killed or interrupted',
    )
    files.add_argument(
        '--report', type=Path, metavar='OUT.html', help='page with pictures of the frames'
    )
    files.add_argument(
        '--csv',
        type=Path,
        metavar='FILE',
        help='one line per region; a frame without regions has one line, without region',
    )
    files.add_argument(
        '--jsonl', type=Path, metavar='FILE', help='one line of JSON per frame, with its regions'
    )
    group = parser.add_argument_group('places on the earth')
    group.add_argument('--geojson', type=Path, metavar='FILE', help=GEOJSON)
    add_geo_options(group)


def add_content_options(group: Any, output: str) -> None:
    """Add what decides the content of the recording that is written."""
    group.add_argument(
        '--compress',
        choices=(PNG, JPEG),
        help=f'photos of {output}, below .../compressed; masks are PNG then, residuals stay raw',
    )
    group.add_argument(
        '--keep-input',
        action='store_true',
        help=f'copy the frames, references, camera_info and fixes that were used into {output}',
    )


def add_geo_options(group: Any) -> None:
    """Add what a bag does not tell of the flight."""
    group.add_argument(
        '--heading',
        type=_heading,
        metavar='DEG|course',
        help="where the image's upper edge points, clockwise from true north; "
        'course: the way the drone flies',
    )
    group.add_argument('--height', type=_metres, metavar='M', help='of the camera above the ground')
    group.add_argument(
        '--ground-altitude',
        type=_altitude,
        metavar='M',
        help='of the ground above the WGS84 ellipsoid; the height is what the fix is above it',
    )
    group.add_argument(
        '--fix', metavar='TOPIC', help='sensor_msgs/NavSatFix; else the only topic of it'
    )


def output_options(args: argparse.Namespace) -> dict[str, Any]:
    """
    Return the fields of a `ReplayJob` that the options fill.

    Raises
    ------
    ConfigError
        If a value that is needed is missing, or an option has no use.

    """
    return {
        'output': args.output,
        'compress': args.compress,
        'keep_input': args.keep_input,
        'resume': args.resume,
        'report': args.report,
        'csv': args.csv,
        'jsonl': args.jsonl,
        'geojson': geo_options(args, args.geojson),
    }


def geo_options(args: argparse.Namespace, path: Path | None) -> GeoOptions | None:
    """
    Return how the map `path` is made, None without one.

    Raises
    ------
    ConfigError
        If a value that is needed is missing, or an option has no use.

    """
    given = {
        'heading': args.heading,
        'height': args.height,
        'ground_altitude': args.ground_altitude,
        'fix': args.fix,
    }
    if path is not None:
        return GeoOptions(path, **given)
    useless = [name for name, value in given.items() if value is not None]
    if useless:
        option = useless[0].replace('_', '-')
        raise ConfigError(f'--{option} is for --geojson, which is missing')
    return None


def _heading(text: str) -> float | str:
    if text == COURSE:
        return COURSE
    return _number(text, -360.0, 360.0, f'degrees from -360 to 360, or {COURSE}')


def _metres(text: str) -> float:
    return _number(text, 0.1, 100_000.0, 'metres, 0.1 to 100000')


def _altitude(text: str) -> float:
    return _number(text, -1000.0, 10_000.0, 'metres, -1000 to 10000')


def _number(text: str, low: float, high: float, allowed: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f'{text!r} must be {allowed}')
    return value
