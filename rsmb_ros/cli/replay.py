"""`rsmb replay`: every frame of a bag through the detector, offline."""

from __future__ import annotations

import argparse
import csv
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np

from rsmb_ros.bags.reading import Bag, BagFrame, Topic
from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.errors import BagError, ConfigError, FrameError
from rsmb_ros.core.types import REGISTERED, Result
from rsmb_ros.messages.outputs import OUTPUTS
from rsmb_ros.report.html import Report
from rsmb_ros.report.overlay import describe, draw_overlay

from .depth_file import add_depth_options, load_depth
from .images import read_image
from .interrupt import Interrupt
from .options import add_config_options, load_config, mcap_path
from .progress import progress

_log = logging.getLogger(__name__)

# Takes a frame, the reference it was compared with and the result.
Sink = Callable[[BagFrame, np.ndarray, Result], None]

REGION_COLUMNS = (
    *('kind', 'x', 'y', 'width', 'height', 'area', 'relative_depth', 'score'),
    *('id', 'first_seen', 'reference_x', 'reference_y', 'shadow_like'),
)
CSV_COLUMNS = ('frame', 'stamp_ns', 'status', *REGION_COLUMNS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help='rosbag2 folder, .mcap, .db3 or ROS 1 .bag'
    )
    parser.add_argument(
        '-o',
        '--output',
        type=mcap_path,
        required=True,
        metavar='OUT.mcap',
        help='everything the node would publish, under /rsmb/',
    )
    parser.add_argument(
        '--reference',
        metavar='FILE|TOPIC',
        help='image file or topic; else the topic named reference/image[/compressed]',
    )
    parser.add_argument(
        '--topic', metavar='NAME', help='live images; else the topic named image[/compressed]'
    )
    parser.add_argument(
        '--report', type=Path, metavar='OUT.html', help='page with pictures of the frames'
    )
    parser.add_argument(
        '--csv',
        type=Path,
        metavar='FILE',
        help='one line per region; a frame without regions has one line, without region',
    )
    add_depth_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Replay the bag and say in one line what came out."""
    config, depth = load_config(args), load_depth(args)
    if args.bag.exists() and args.output.resolve() == args.bag.resolve():
        raise ConfigError(f'-o {args.output} is the bag to be read; choose another name')
    with ExitStack() as stack:
        bag = stack.enter_context(Bag(args.bag))
        live, reference = _choose(bag, args)
        results = _results(bag, live, reference, config, depth)
        first = next(results, None)
        if first is None:
            raise BagError(f'{args.bag}: no frame of {live.name} can be read')
        sinks: list[Sink] = [_to_bag(stack.enter_context(BagWriter(args.output, config)))]
        if args.csv:
            sinks.append(_to_csv(stack.enter_context(args.csv.open('w', newline=''))))
        summary = _Summary(live.name)
        sinks.append(summary.take)
        if args.report:
            report = Report(f'Replay of {args.bag.name}', live.count)
            sinks.append(_to_report(report))
            stack.callback(lambda: report.write(args.report, summary.values(bag)))
        interrupt = stack.enter_context(Interrupt())
        for result in progress(chain([first], results), live.count, live.name):
            interrupt.check()
            for sink in sinks:
                sink(*result)
    print(f'{summary.line(bag)} -> {args.output}')
    return 0


def _choose(bag: Bag, args: argparse.Namespace) -> tuple[Topic, np.ndarray | Topic]:
    """Return the live topic, and the reference or its topic."""
    named = args.reference
    reference: np.ndarray | Topic
    if named and Path(named).is_file():
        reference = read_image(Path(named))
    elif named:
        try:
            reference = bag.image_topic(named)
        except BagError as error:
            raise BagError(f'--reference {named} is neither a file nor a topic: {error}') from error
    else:
        reference = bag.guess_reference()
    taken = reference.name if isinstance(reference, Topic) else None
    live = bag.image_topic(args.topic) if args.topic else bag.guess_live(taken)
    if live.name == taken:
        raise ConfigError(f'--topic and --reference are both {taken}; must be two topics')
    return live, reference


def _results(
    bag: Bag,
    live: Topic,
    reference: np.ndarray | Topic,
    config: Config,
    depth: np.ndarray | None,
) -> Iterator[tuple[BagFrame, np.ndarray, Result]]:
    """
    Iterate over frames, the reference of each, and results; a newer reference takes over.

    `depth` is that of the only reference.
    """
    focal_px = bag.focal_px()
    camera = None if focal_px is None else Camera(focal_px)
    topics = [live.name]
    if isinstance(reference, Topic):
        topics.append(reference.name)
        image = next((frame.image for frame in bag.frames(reference.name)), None)
        if image is None:
            raise BagError(f'{bag.path}: no image of {reference.name} can be read')
        bag.skipped.clear()  # they will be met, and counted, once more
    else:
        image = reference
    detector = Detector(image, camera, config, depth)
    for frame in bag.frames(*topics):
        if frame.topic != live.name:
            if not np.array_equal(frame.image, detector.reference):
                if depth is not None:
                    raise BagError(
                        f'{bag.path}: image {frame.index} of {frame.topic} is another reference '
                        'than the one --depth describes; give one with --reference FILE'
                    )
                detector = Detector(frame.image, camera, config)
            continue
        try:
            result = detector.detect(frame.image, frame.stamp_ns or None)
        except FrameError as error:
            bag.skipped[live.name] += 1
            _log.warning('%s: frame %d of %s skipped: %s', bag.path, frame.index, live.name, error)
            continue
        yield frame, detector.reference, result


def _to_bag(writer: BagWriter) -> Sink:
    factory = BagFactory()

    def take(frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        for output in OUTPUTS:
            message = output.build(result, frame.image, factory, frame.header)
            writer.write(f'/rsmb/{output.name}', message, frame.stamp_ns or frame.log_time_ns)

    return take


def _to_csv(stream: TextIO) -> Sink:
    table = csv.writer(stream)
    table.writerow(CSV_COLUMNS)

    def take(frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        start = [frame.index, frame.stamp_ns, result.status]
        rows = [[getattr(region, name) for name in REGION_COLUMNS] for region in result.regions]
        table.writerows(start + row for row in rows or [[None] * len(REGION_COLUMNS)])
        stream.flush()  # an interrupted replay leaves whole lines

    return take


def _to_report(report: Report) -> Sink:
    def take(frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        if report.wants(frame.index):
            pictures = {
                'reference': reference,
                'live': frame.image,
                'registered': result.registered,
                'what changed': draw_overlay(frame.image, result),
            }
            report.add(frame.index, f'frame {frame.index}', describe(result), pictures)

    return take


class _Summary:
    """Counts what came out."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._counts: Counter[str] = Counter()
        self._start = time.monotonic()

    def take(self, frame: BagFrame, reference: np.ndarray, result: Result) -> None:
        """Count one frame."""
        self._counts['frames'] += 1
        self._counts['registered'] += result.status == REGISTERED
        self._counts['with changes'] += bool(result.changes)
        self._counts['changes'] += len(result.changes)

    def values(self, bag: Bag) -> dict[str, str]:
        """Return the numbers by name."""
        counts = self._counts
        hz = counts['frames'] / (time.monotonic() - self._start)
        return {
            'bag': str(bag.path),
            'topic': self._topic,
            'frames': f'{counts["frames"]}, {bag.skipped[self._topic]} more could not be read',
            'registered': str(counts['registered']),
            'frames with changes': f'{counts["with changes"]}, {counts["changes"]} changes in all',
            'speed': f'{hz:.1f} frames/s, outputs included',
        }

    def line(self, bag: Bag) -> str:
        """Return the numbers in one line."""
        return '; '.join(f'{name}: {value}' for name, value in self.values(bag).items())
