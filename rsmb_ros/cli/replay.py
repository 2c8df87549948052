"""`rsmb replay`: every frame of a bag through the detector, offline."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from rsmb_ros.replay.job import ReplayJob, replay

from .depth_file import add_depth_options, load_depth
from .interrupt import Interrupt
from .options import add_config_options, load_config
from .output_options import add_output_options, output_options
from .progress import progress

T = TypeVar('T')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help='rosbag2 folder, .mcap, .db3 or ROS 1 .bag'
    )
    parser.add_argument(
        '--reference',
        metavar='FILE|TOPIC',
        help='image file or topic; else the topic named reference/image[/compressed]',
    )
    parser.add_argument(
        '--topic', metavar='NAME', help='live images; else the topic named image[/compressed]'
    )
    add_output_options(parser)
    add_depth_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Replay the bag and say in one line what came out."""
    job = ReplayJob(
        source=args.bag,
        reference=args.reference,
        topic=args.topic,
        config=load_config(args),
        depth=load_depth(args),
        **output_options(args),
    )
    summary = replay(job, watched)
    print(f'{summary.line()} -> {args.output}')
    return 0


def watched(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """Iterate over `items` with a bar on a terminal; Ctrl-C waits for the item in work."""
    with Interrupt() as interrupt:
        for item in progress(items, total, what):
            interrupt.check()
            yield item
