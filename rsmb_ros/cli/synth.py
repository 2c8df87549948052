"""`rsmb synth`: synthetic flights and suites with truth, as image files or as a bag."""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rsmb_ros.bags.image_files import read_image
from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import (
    HOVER,
    MOTIONS,
    SUBURB,
    USUAL,
    FlightPlan,
    Nuisances,
    SyntheticFlight,
    SyntheticFrame,
)
from rsmb_ros.evaluation.case import Case
from rsmb_ros.evaluation.suites import NUISANCES, SUITES, Wish
from rsmb_ros.evaluation.suites.recipe import case_of
from rsmb_ros.messages.as_json import to_json

from .images import output_folder
from .options import data_folder, frame_size, within
from .progress import progress
from .truth_folder import write_frame, write_truth

FRAME_ID = 'camera'
START_NS = 1_700_000_000_000_000_000  # stamp of a bag's reference: a fixed day, equal files
SIZE = (480, 640)  # rows, cols
EXPOSURE_ROWS = 50.0
READOUTS = ('top_down', 'bottom_up', 'global')
# Allowed values of what a camera adds, see `core.synthesis.Nuisances`.
RANGES = {
    'gain': (0.05, 20.0),
    'bias': (-50.0, 50.0),
    'vignetting': (0.0, 0.95),
    'overexposure': (0.1, 20.0),
    'defocus_px': (0.0, 10.0),
    'noise_electrons': (10.0, 1e9),
    'read_noise': (0.0, 50.0),
    'mosaic': (0, 1),
    'gamma': (1.0, 3.0),
    'contrast': (-1.0, 1.0),
    'warmth': (-0.5, 0.5),
    'sharpening': (0.0, 5.0),
    'jpeg_quality': (0, 100),
    'distortion': (-0.05, 0.05),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='DIR|BAG.mcap', help='what to write'
    )
    parser.add_argument('--seed', type=within(int, 0, 2**32), default=1)
    parser.add_argument('--size', type=frame_size, metavar='COLSxROWS', help='default: 640x480')
    _add_scene(parser.add_argument_group('scene'))
    _add_camera(parser.add_argument_group('camera'))
    _add_suite(parser.add_argument_group('a suite of `rsmb evaluate` instead, as folders'))


def _add_scene(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--background', type=Path, help='photo to fly over; default: drawn suburb')
    group.add_argument('--houses', type=within(int, 0, 40), default=SUBURB.houses)
    group.add_argument('--trees', type=within(int, 0, 60), default=0, help='that stand out')
    group.add_argument(
        '--texture', type=within(float, 0, 1), default=1.0, help='contrast of the drawn ground'
    )
    group.add_argument('--objects', type=within(int, 0, 20), default=2, help='that appear')
    group.add_argument('--vanished', type=within(int, 0, 20), default=0, help='that are gone')
    group.add_argument(
        '--shadows', type=within(float, 0, 1), default=0.0, help='light their shadows take'
    )


def _add_camera(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--frames', type=within(int, 1, 100_000), default=1, help='live frames')
    group.add_argument('--rate', type=within(float, 0.01, 1000), default=5.0, help='frames/s')
    group.add_argument(
        '--offset', type=within(float, 0, 1000), default=20.0, help='distance from reference [px]'
    )
    group.add_argument('--motion', choices=(HOVER, *MOTIONS), default=HOVER, help='of the rows')
    group.add_argument(
        '--blur', type=within(float, 0, 100), default=8.0, help='motion blur of a row [px]'
    )
    group.add_argument(
        '--exposure-rows',
        type=within(float, 0, 5000),
        help=f'exposure / line delay [rows], 0: no blur; default: {EXPOSURE_ROWS:g}',
    )
    group.add_argument('--exposure-ms', type=within(float, 0, 1000), help='the same in seconds ...')
    group.add_argument('--line-delay-us', type=within(float, 0.1, 1e5), help='... needs both')
    group.add_argument(
        '--focal-px', type=within(float, 0, 1e5), default=0.0, help='0: 0.9 x the width'
    )
    group.add_argument('--readout', choices=READOUTS, default=READOUTS[0])
    group.add_argument(
        '--jpeg-quality', type=within(int, 1, 100), default=USUAL.jpeg_quality, help='1..100'
    )
    group.add_argument(
        '--ideal', action='store_true', help='no noise, vignetting, gain or JPEG in image files'
    )
    group.add_argument(
        '--nuisance',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='what the camera adds; repeatable: '
        + ', '.join(f'{name} {low:g}..{high:g}' for name, (low, high) in RANGES.items()),
    )


def _add_suite(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        '--suite', choices=SUITES, metavar='NAME', help=f'one of {", ".join(SUITES)}'
    )
    group.add_argument('--first', type=within(int, 1, 10_000), help='so many of its cases only')
    group.add_argument('--nuisances', choices=NUISANCES, default=NUISANCES[0])
    group.add_argument('--data', type=Path, metavar='DIR', help='real pictures; else RSMB_DATA')


def run(args: argparse.Namespace) -> int:
    """Write the flight or the suite; returns the exit code."""
    if args.suite:
        return _write_suite(args)
    as_bag = args.output.suffix == '.mcap'
    nuisances = nuisances_of(args)
    if nuisances.distortion and args.background and not args.vanished:
        raise ConfigError(
            '--nuisance distortion bends the reference too, but --background is one as it is'
        )
    quality = nuisances.jpeg_quality or args.jpeg_quality
    if as_bag:  # a bag stores what the camera would compress
        nuisances = replace(nuisances, jpeg_quality=0)
    timing = timing_of(args)
    plan = FlightPlan(
        frames=args.frames,
        rate=args.rate,
        offset_px=args.offset,
        blur_px=args.blur if timing.exposure_rows else 0.0,
        timing=timing,
        objects=args.objects,
        nuisances=nuisances,
        seed=args.seed,
        shadows=args.shadows,
        vanished=args.vanished,
        motion=args.motion,
        focal_px=args.focal_px,
        style=replace(SUBURB, houses=args.houses, crowns=args.trees, texture=args.texture),
    )
    background = read_image(args.background) if args.background else None
    flight = SyntheticFlight(plan, args.size or SIZE, background)
    if as_bag:
        _write_bag(flight, args, quality)
    else:
        _write_files(flight, args)
    print(f'{args.output}: {args.frames} live frames with truth')
    return 0


def nuisances_of(args: argparse.Namespace) -> Nuisances:
    """Return what the camera adds, by ``--ideal``, ``--jpeg-quality`` and ``--nuisance``."""
    kinds: dict[str, type] = {item.name: type(item.default) for item in fields(Nuisances)}
    values: dict[str, Any] = {}
    for text in args.nuisance:
        name, equals, number = text.partition('=')
        if name not in RANGES or not equals:
            raise ConfigError(
                f'--nuisance {text!r} must be NAME=VALUE, NAME one of {", ".join(RANGES)}'
            )
        kind = float if kinds[name] is float else int
        try:
            values[name] = kinds[name](within(kind, *RANGES[name])(number))
        except argparse.ArgumentTypeError as error:
            raise ConfigError(f'--nuisance {name}: {error}') from error
    base = Nuisances() if args.ideal else replace(USUAL, jpeg_quality=args.jpeg_quality)
    return replace(base, **values)


def timing_of(args: argparse.Namespace) -> ShutterTiming:
    """Return the shutter, in rows or from seconds."""
    in_seconds = (args.exposure_ms, args.line_delay_us)
    if args.exposure_rows is not None and in_seconds != (None, None):
        raise ConfigError('--exposure-rows excludes --exposure-ms and --line-delay-us')
    if (args.exposure_ms is None) != (args.line_delay_us is None):
        raise ConfigError('--exposure-ms and --line-delay-us need each other')
    if args.exposure_ms is not None:
        timing = ShutterTiming.from_seconds(1e-3 * args.exposure_ms, 1e-6 * args.line_delay_us)
    else:
        rows = EXPOSURE_ROWS if args.exposure_rows is None else args.exposure_rows
        timing = ShutterTiming(rows)
    return replace(timing, rolling=args.readout != 'global', bottom_up=args.readout == 'bottom_up')


def _write_suite(args: argparse.Namespace) -> int:
    if args.output.suffix == '.mcap':
        raise ConfigError(f'--suite {args.suite} writes folders, not the bag {args.output}')
    suite = SUITES[args.suite]
    wish = Wish(args.size, args.nuisances, data_folder(args.data), args.first)
    suite.check(wish)
    root = output_folder(args.output)
    count = min(suite.size, args.first or suite.size)
    for case in progress(suite.cases(wish), count, 'synth'):
        folder = output_folder(root / case.name.partition('/')[2].replace('/', ' '))
        entry = write_frame(folder, 0, case)
        write_truth(folder, case.reference, {'focal_px': case.focal_px}, [entry])
    print(f'{args.output}: {count} cases of {suite.name} with truth')
    return 0


def _write_files(flight: SyntheticFlight, args: argparse.Namespace) -> None:
    folder = output_folder(args.output)
    entries = []
    for frame in progress(flight.frames(), args.frames, 'synth'):
        entries.append(write_frame(folder, frame.index, _case(flight, frame)))
    plan = {**asdict(flight.plan), 'nuisances': flight.plan.nuisances.as_dict()}
    about = {
        'plan': plan,
        'focal_px': flight.camera.focal_px,
        'nuisances': plan['nuisances'],
    }
    write_truth(folder, flight.reference, about, entries)


def _case(flight: SyntheticFlight, frame: SyntheticFrame) -> Case:
    return case_of(
        f'{frame.index:03d}',
        flight.reference,
        frame.live,
        frame.truth,
        flight.camera.focal_px,
        {'time_s': frame.time, 'objects': frame.truth.boxes},
    )


def _write_bag(flight: SyntheticFlight, args: argparse.Namespace, quality: int) -> None:
    factory = BagFactory()
    shape = flight.reference.shape[:2]
    with BagWriter(args.output) as bag:
        header = factory.header(START_NS, FRAME_ID)
        reference = _jpeg(flight.reference, quality)
        bag.write(
            '/reference/image/compressed',
            factory.compressed(header, reference, 'jpeg'),
            START_NS,
            latched=True,
        )
        for frame in progress(flight.frames(), args.frames, 'synth'):
            stamp = START_NS + round(frame.time * 1e9)
            header = factory.header(stamp, FRAME_ID)
            live = _jpeg(frame.live, quality)
            label = cv2.imencode('.png', frame.truth.label)[1].tobytes()
            info = factory.camera_info(header, shape, flight.camera.focal_px)
            bag.write('/camera_info', info, stamp)
            bag.write('/image/compressed', factory.compressed(header, live, 'jpeg'), stamp)
            bag.write('/truth/change_mask', factory.compressed(header, label, 'png'), stamp)
            bag.write('/truth/scene', factory.text(to_json(_truth(frame))), stamp)


def _truth(frame: SyntheticFrame) -> dict[str, Any]:
    """Objects as x, y, width, height [px], exposure, centroid pose of each row."""
    return {
        'objects': frame.truth.boxes,
        'exposure_rows': frame.truth.exposure_rows,
        'centroids': np.round(frame.truth.centroids, 5).tolist(),
    }


def _jpeg(image: np.ndarray, quality: int) -> bytes:
    return cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
