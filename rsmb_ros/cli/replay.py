"""`rsmb replay`: every frame of a recording through the detector, offline."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TypeVar

from rsmb_ros.bags.check import check
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.replay.job import MOST_WORKERS, ReplayJob, replay
from rsmb_ros.replay.selection import Selection
from rsmb_ros.replay.targets import check_targets

from .depth_file import add_depth_options, load_depth
from .interrupt import Interrupt
from .options import add_config_options, frame_rate, load_config, within
from .output_options import add_output_options, output_options
from .progress import progress

T = TypeVar('T')
MOST = 10**9  # frames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        'bag',
        type=Path,
        metavar='BAG',
        help='rosbag2 folder, .mcap, .db3, ROS 1 .bag, video file or folder of .png or .jpg images',
    )
    parser.add_argument(
        '--check',
        action='store_true',
        help='replay nothing: read every message, compare every checksum, decode every image; '
        'exit code 1 if the recording is damaged',
    )
    add_input_options(parser)
    add_output_options(parser)
    parser.add_argument(
        '--workers',
        type=within(int, 1, MOST_WORKERS),
        default=1,
        metavar='N',
        help='processes that share the frames; what is written does not depend on it. The cores '
        'are shared out as threads, unless worker.threads is changed',
    )
    add_depth_options(parser)
    add_config_options(parser)


def add_input_options(parser: argparse.ArgumentParser) -> None:
    """Add what says which frames are compared with what."""
    parser.add_argument(
        '--reference',
        metavar='WHAT',
        help='image file; topic, whose newest image counts; or one frame: @WHICH of the live '
        'images, TOPIC@WHICH, or of another recording FILE@WHICH, FILE:TOPIC@WHICH. WHICH is an '
        'index from 0 (@0) or a stamp in seconds with a decimal point (@12.5), nearest frame. '
        'Default: the topic named reference/image[/compressed]. A live frame that is the '
        'reference is compared with itself',
    )
    parser.add_argument(
        '--topic', metavar='NAME', help='live images; else the only one, or image[/compressed]'
    )
    for name, what in (('start', 'first'), ('end', 'last')):
        parser.add_argument(
            f'--{name}',
            type=_time_ns,
            metavar='SECONDS',
            help=f'{what} time replayed: from the first live frame; from 100000000 on, a stamp',
        )
    parser.add_argument(
        '--stride', type=within(int, 1, MOST), default=1, metavar='N', help='every N-th frame only'
    )
    parser.add_argument(
        '--max-frames', type=within(int, 1, MOST), metavar='N', help='end after so many frames'
    )
    parser.add_argument(
        '--rate',
        type=frame_rate,
        metavar='HZ',
        help='frames/s of a folder of images (default: 10) or of a video (default: its own times)',
    )


def run(args: argparse.Namespace) -> int:
    """Replay the recording and say in one line what came out."""
    if args.check:
        return _check(args)
    if args.output is None:
        raise ConfigError('-o OUT.mcap is missing: where to write; or --check to write nothing')
    job = ReplayJob(
        source=args.bag,
        reference=args.reference,
        topic=args.topic,
        selection=selection_of(args),
        rate=args.rate,
        config=load_config(args),
        depth=load_depth(args),
        workers=args.workers,
        **output_options(args),
    )
    given = {'--config': args.config, '--depth': args.depth}
    check_targets(job.targets(), {name: path for name, path in given.items() if path})
    try:
        summary = replay(job, watched)
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt('--resume goes on with it') from error
    print(f'{summary.line()} -> {args.output}')
    return 0


def selection_of(args: argparse.Namespace) -> Selection:
    """Return the frames that `add_input_options` tell."""
    return Selection(args.start, args.end, args.stride, args.max_frames)


def _check(args: argparse.Namespace) -> int:
    """Say topic by topic whether the recording is whole."""
    if args.output is not None:
        raise ConfigError(f'--check writes nothing: leave -o {args.output}')
    checked = check(args.bag)
    print('\n'.join([*checked.lines, f'{args.bag}: {"damaged" if checked.damaged else "whole"}']))
    return 1 if checked.damaged else 0


def _time_ns(text: str) -> int:
    """Return seconds as nanoseconds, without loss, for argparse."""
    try:
        value = Decimal(text)
        good = value.is_finite() and 0 <= value < 10**10
    except InvalidOperation:
        good = False
    if not good:
        raise argparse.ArgumentTypeError(f'{text!r} must be seconds, from 0 to 9999999999')
    return int(value * 10**9)


def watched(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Iterate over `items` with a bar on a terminal; Ctrl-C waits for the item in work."""
    with Interrupt() as interrupt:
        for item in progress(items, total, what):
            interrupt.check()
            yield item
