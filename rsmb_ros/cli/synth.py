"""`rsmb synth`: synthetic flights with truth, as image files or as a bag."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.core.sequence import USUAL, FlightPlan, SyntheticFlight, SyntheticFrame
from rsmb_ros.core.synthesis import Nuisances
from rsmb_ros.messages.as_json import to_json

from .images import output_folder, read_image, write_png, write_whole
from .progress import progress

FRAME_ID = 'camera'
START_NS = 1_700_000_000_000_000_000  # stamp of a bag's reference: a fixed day, equal files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='DIR|BAG.mcap', help='what to write'
    )
    parser.add_argument(
        '--background', type=Path, help='photo to fly over; default: a drawn suburb'
    )
    parser.add_argument('--size', type=_size, default=(480, 640), metavar='COLSxROWS')
    parser.add_argument('--frames', type=_within(int, 1, 100_000), default=1, help='live frames')
    parser.add_argument('--rate', type=_within(float, 0.01, 1000), default=5.0, help='frames/s')
    parser.add_argument(
        '--offset', type=_within(float, 0, 1000), default=20.0, help='distance from reference [px]'
    )
    parser.add_argument(
        '--blur', type=_within(float, 0, 100), default=8.0, help='motion blur of a row [px]'
    )
    parser.add_argument(
        '--exposure-rows',
        type=_within(float, 0, 5000),
        default=50.0,
        help='exposure / line delay [rows]; 0: no blur',
    )
    parser.add_argument(
        '--objects', type=_within(int, 0, 20), default=2, help='objects that appear'
    )
    parser.add_argument(
        '--jpeg-quality', type=_within(int, 1, 100), default=USUAL.jpeg_quality, help='1..100'
    )
    parser.add_argument(
        '--ideal', action='store_true', help='no noise, vignetting, gain or JPEG in image files'
    )
    parser.add_argument('--seed', type=_within(int, 0, 2**32), default=1)


def run(args: argparse.Namespace) -> int:
    """Write the flight; returns the exit code."""
    nuisances = Nuisances() if args.ideal else replace(USUAL, jpeg_quality=args.jpeg_quality)
    as_bag = args.output.suffix == '.mcap'
    if as_bag:  # a bag stores what the camera would compress
        nuisances = replace(nuisances, jpeg_quality=0)
    plan = FlightPlan(
        frames=args.frames,
        rate=args.rate,
        offset_px=args.offset,
        blur_px=args.blur if args.exposure_rows else 0.0,
        exposure_rows=args.exposure_rows,
        objects=args.objects,
        nuisances=nuisances,
        seed=args.seed,
    )
    background = read_image(args.background) if args.background else None
    flight = SyntheticFlight(plan, args.size, background)
    write = _write_bag if as_bag else _write_files
    write(flight, args)
    print(f'{args.output}: {args.frames} live frames with truth')
    return 0


def _write_files(flight: SyntheticFlight, args: argparse.Namespace) -> None:
    folder = output_folder(args.output)
    write_png(folder / 'reference.png', flight.reference)
    truths = []
    for frame in progress(flight.frames(), args.frames, 'synth'):
        write_png(folder / f'live_{frame.index:03d}.png', frame.live)
        write_png(folder / f'truth_{frame.index:03d}.png', frame.truth.label)
        truths.append({'frame': frame.index, 'time_s': frame.time, **_truth(frame)})
    about = {'plan': asdict(flight.plan), 'focal_px': flight.camera.focal_px, 'frames': truths}
    write_whole(folder / 'truth.json', to_json(about).encode())


def _write_bag(flight: SyntheticFlight, args: argparse.Namespace) -> None:
    factory = BagFactory()
    shape = flight.reference.shape[:2]
    with BagWriter(args.output) as bag:
        header = factory.header(START_NS, FRAME_ID)
        reference = _jpeg(flight.reference, args.jpeg_quality)
        bag.write(
            '/reference/image/compressed',
            factory.compressed(header, reference, 'jpeg'),
            START_NS,
            latched=True,
        )
        for frame in progress(flight.frames(), args.frames, 'synth'):
            stamp = START_NS + round(frame.time * 1e9)
            header = factory.header(stamp, FRAME_ID)
            live = _jpeg(frame.live, args.jpeg_quality)
            label = cv2.imencode('.png', frame.truth.label)[1].tobytes()
            info = factory.camera_info(header, shape, flight.camera.focal_px)
            bag.write('/camera_info', info, stamp)
            bag.write('/image/compressed', factory.compressed(header, live, 'jpeg'), stamp)
            bag.write('/truth/change_mask', factory.compressed(header, label, 'png'), stamp)
            bag.write('/truth/scene', factory.text(to_json(_truth(frame))), stamp)


def _truth(frame: SyntheticFrame) -> dict[str, Any]:
    """Objects as x, y, width, height [px], exposure, centroid pose of each row."""
    return {
        'objects': frame.truth.objects,
        'exposure_rows': frame.truth.exposure_rows,
        'centroids': np.round(frame.truth.centroids, 5).tolist(),
    }


def _jpeg(image: np.ndarray, quality: int) -> bytes:
    return cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def _size(text: str) -> tuple[int, int]:
    """Parse COLSxROWS into (rows, cols)."""
    found = re.fullmatch(r'(\d+)x(\d+)', text)
    cols, rows = (int(group) for group in found.groups()) if found else (0, 0)
    if not (240 <= rows <= 4320 and 320 <= cols <= 7680):
        raise argparse.ArgumentTypeError(f'{text!r} must be COLSxROWS, 320x240 to 7680x4320')
    return rows, cols


def _within(kind: type, low: float, high: float) -> Callable[[str], Any]:
    """Return an argparse type for numbers from `low` to `high`."""

    def parse(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r} must be a number from {low} to {high}')
        return value

    return parse
