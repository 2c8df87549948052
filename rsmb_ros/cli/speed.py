"""`rsmb speed`: time beside ECC's and the floor, over sizes, of the rows, in a stream."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2

from rsmb_ros.core import Config, warm_up
from rsmb_ros.core.errors import ConfigError, FileProblem
from rsmb_ros.evaluation.speed.flights import (
    FLIGHTS,
    SCENES,
    flights_at,
    frames_at,
    timed_flight,
)
from rsmb_ros.evaluation.speed.machine import measured_rates
from rsmb_ros.evaluation.speed.probes import STARTS, peak_memory, start_ups
from rsmb_ros.evaluation.speed.results import Finding, SpeedResults
from rsmb_ros.evaluation.speed.rows import SUITE, row_times
from rsmb_ros.evaluation.speed.spread import size_name
from rsmb_ros.evaluation.speed.stream import stream_frames
from rsmb_ros.evaluation.speed.timing import times_of_flight

from .images import write_whole
from .options import add_config_options, frame_size, load_config, within
from .progress import narrated

PARTS = {
    'sizes': 'ratio to ECC, cost a pixel, floor, memory, steps',
    'stream': 'exposure, lost frames, warm against cold start',
    'rows': 'the row estimator at 384x256',
    'start': 'compiling and loading the kernels',
}
SIZES = ('320x240', '640x480', '1280x720', '1920x1080')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.epilog = f'Parts: {"; ".join(f"{name}: {about}" for name, about in PARTS.items())}.'
    parser.add_argument(
        '--parts', default=','.join(PARTS), metavar='NAME,...', help='default: %(default)s'
    )
    parser.add_argument(
        '--sizes',
        nargs='+',
        type=frame_size,
        default=[frame_size(text) for text in SIZES],
        metavar='COLSxROWS',
        help=f'default: {" ".join(SIZES)}',
    )
    parser.add_argument(
        '--flights',
        type=within(int, 1, 100),
        default=len(FLIGHTS),
        help='of each scene, less at sizes above 640x480; default: %(default)s',
    )
    parser.add_argument(
        '--repeats',
        type=within(int, 1, 1000),
        default=3,
        help='frames of each flight, one less above 1 Mpx; default: %(default)s',
    )
    parser.add_argument(
        '--stream',
        type=within(int, 1, 100_000),
        default=300,
        metavar='FRAMES',
        help='length of the stream; default: %(default)s',
    )
    parser.add_argument(
        '--rows',
        type=within(int, 1, SUITE.size),
        default=8,
        metavar='FRAMES',
        help='for the row estimator; default: %(default)s',
    )
    parser.add_argument('--markdown', type=Path, metavar='OUT.md', help='tables as markdown')
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Measure, print the tables, write what is asked for."""
    config = load_config(args)
    if config.registration.estimator != 'path':
        raise ConfigError(
            'registration.estimator must be path: the part rows measures the other one'
        )
    parts = _parts(args.parts)
    if args.markdown is not None and not args.markdown.parent.is_dir():
        raise FileProblem(f'{args.markdown}: cannot be written: no folder {args.markdown.parent}')
    total = sum(_count(part, args) for part in parts)
    done = 0
    with _opencv_threads(config.worker.threads):
        warm_up(config)  # compiling is no part of a frame
        results = SpeedResults(measured_rates(config.worker.threads), config, _about(args, parts))
        with suppress(KeyboardInterrupt):  # what was measured until then is worth having
            findings: Iterator[Finding] = narrated(_measured(parts, args, config), total, 'speed')
            for found in findings:
                done += 1
                results.add(found)
    if results.tables():
        print(results.as_text())
        if args.markdown:
            write_whole(args.markdown, results.as_markdown().encode())
    if done < total:
        print(f'interrupted: {done} of {total} measurements')
        raise KeyboardInterrupt
    return 0


def _parts(text: str) -> list[str]:
    names = list(dict.fromkeys(text.split(',')))
    for name in names:
        if name not in PARTS:
            raise ConfigError(f'part {name!r} is not known: {", ".join(PARTS)}')
    return names


def _count(part: str, args: argparse.Namespace) -> int:
    """Return how many measurements a part makes."""
    frames = [
        flights_at(shape, args.flights) * frames_at(shape, args.repeats) for shape in args.sizes
    ]
    counts = {
        'sizes': len(SCENES) * sum(frames) + len(args.sizes),
        'stream': args.stream,
        'rows': args.rows,
        'start': STARTS,
    }
    return counts[part]


def _measured(
    parts: list[str], args: argparse.Namespace, config: Config
) -> Iterator[Finding | str]:
    """Yield each measurement, before it what is being done."""
    for part in parts:
        if part == 'sizes':
            yield from _sizes(args, config)
        elif part == 'stream':
            yield f'a stream of {args.stream} frames'
            yield from stream_frames(args.stream, config)
        elif part == 'rows':
            yield 'row estimator'
            yield from row_times(config, args.rows)
        else:
            yield 'compiling the kernels, loading them'
            yield from start_ups(config)


def _sizes(args: argparse.Namespace, config: Config) -> Iterator[Finding | str]:
    for shape in args.sizes:
        name = size_name(shape)
        for scene in SCENES:
            for number in range(flights_at(shape, args.flights)):
                yield f'drawing {name}, {scene}'
                flight = timed_flight(scene, number, shape, frames_at(shape, args.repeats))
                yield f'timing {name}, {scene}'
                yield from times_of_flight(flight, config)
        yield f'memory at {name}'
        yield peak_memory(flight, config)  # the last one is layered, it has most in it


def _about(args: argparse.Namespace, parts: list[str]) -> dict[str, object]:
    sizes = (
        f'{args.flights} flights of {args.repeats} frames planar and layered each, less if large'
    )
    said: dict[str, object] = {'parts': ' '.join(parts)}
    if 'sizes' in parts:
        said['sizes'] = sizes
    if 'stream' in parts:
        said['stream'] = f'{args.stream} frames as `rsmb synth --frames {args.stream}` makes them'
    return said


@contextmanager
def _opencv_threads(count: int) -> Iterator[None]:
    """Give OpenCV, ECC's and ours, as many threads as the detector has."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
