"""`rsmb demo`: the real node, played a bag over real topics, scored against the bag's truth."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from rsmb_ros.bags.pacing import paced
from rsmb_ros.bags.reading import CAMERA_INFO, COMPRESSED, Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError, FileProblem

from .demo_report import print_tables, read_truth, write_pictures
from .images import output_folder
from .interrupt import Interrupt
from .options import add_config_options, frame_rate, load_config, require_ros

if TYPE_CHECKING:
    from rsmb_ros.ros.playback import Answers, Playback

READY_S = 300.0  # to compile every kernel on a slow machine
ALL_ANSWERS_S = 60.0  # after the last frame
EXIT_S = 10.0  # after SIGINT
DEFAULT_BAG = Path('bags', 'demo.mcap')
TRUTH = '/truth/'  # topics below it are recorded, never played


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument(
        '--bag', type=Path, metavar='BAG', help='ROS 2 bag; default: the one that comes along'
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('out'),
        metavar='DIR',
        help='folder for demo.mcap, demo.html, demo.png and node.log (default: out)',
    )
    parser.add_argument(
        '--rate', type=frame_rate, metavar='HZ', help='frames per second; default: as recorded'
    )
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Play, record, score and show."""
    config = load_config(args)
    require_ros()
    with Bag(args.bag or default_bag()) as bag:
        script = _Script(bag, args.rate)
        truth = read_truth(bag, script.live.name)
        folder = output_folder(args.output)
        print(f'playing {bag.path} to the node, whose log is {folder / "node.log"}', flush=True)
        answers = _perform(script, config, folder)
    write_pictures(folder, answers, truth)
    print_tables(answers, truth)
    print(f'-> {folder / "demo.mcap"}, {folder / "demo.html"}, {folder / "demo.png"}')
    return 0


def default_bag() -> Path:
    """Return the demo bag of the source tree or of the installed package."""
    roots = [Path(__file__).parents[2], Path(sys.prefix, 'share', 'rsmb_ros')]
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    roots += [Path(prefix, 'share', 'rsmb_ros') for prefix in prefixes if prefix]
    for root in roots:
        if (root / DEFAULT_BAG).is_file():
            return root / DEFAULT_BAG
    searched = ', '.join(map(str, roots))
    raise FileProblem(f'{DEFAULT_BAG}: not found below {searched}; name a bag with --bag')


class _Script:
    """
    What of a bag is played when.

    Raises
    ------
    BagError
        If reference and live images cannot be told or are not of one type.

    """

    def __init__(self, bag: Bag, rate: float | None) -> None:
        self.reference = bag.guess_reference()
        self.live = bag.guess_live(self.reference.name)
        if self.live.type != self.reference.type:
            raise BagError(
                f'{bag.path}: {self.reference.name} holds {self.reference.type} and '
                f'{self.live.name} holds {self.live.type}; the node takes one type for both'
            )
        self.compressed = self.live.type == COMPRESSED
        self._bag = bag
        self._rate = rate
        _, _, self._first_reference = next(bag.cdr(self.reference.name))
        infos = [topic.name for topic in bag.topics if topic.type == CAMERA_INFO and topic.count]
        self._info = infos[0] if len(infos) == 1 else None
        self._types = {t.name: t.type for t in bag.topics if t.name.startswith(TRUTH)}

    def perform(self, playback: Playback, writer: BagWriter) -> None:
        """Play the first reference, wait until it was taken, then every frame at its time."""
        if self._info:
            # before the first frame, so that no frame is judged with a guessed focal length
            _, _, info = next(self._bag.cdr(self._info))
            playback.give_camera_info(info, time.time_ns())
        playback.give_reference(self._first_reference)
        topics = [self.live.name, *([self._info] if self._info else []), *self._types]
        start_s = time.monotonic()
        for moment in paced(self._bag.cdr(*topics), self.live.name, self._rate):
            playback.spin_until(start_s + moment.offset_s)
            # one time for all: truth belongs to the frame that was recorded at its moment
            now_ns = time.time_ns()
            for topic, data in moment.messages:
                if topic == self.live.name:
                    playback.play(data, now_ns)
                elif topic == self._info:
                    playback.give_camera_info(data, now_ns)
                else:
                    writer.write_cdr(topic, self._types[topic], data, now_ns)


def _perform(script: _Script, config: Config, folder: Path) -> Answers:
    """Start the node, play to it, record, stop it; return what it answered."""
    from rsmb_ros.ros.domain import isolated_domain
    from rsmb_ros.ros.node_process import NodeProcess
    from rsmb_ros.ros.playback import Playback
    from rsmb_ros.ros.transport import apply_profile

    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(isolated_domain(scratch))
        apply_profile(os.environ, Path.cwd())
        writer = stack.enter_context(BagWriter(folder / 'demo.mcap', config))
        arguments = _node_arguments(config, script.compressed, scratch)
        process = stack.enter_context(NodeProcess(arguments, folder / 'node.log'))
        interrupt = stack.enter_context(Interrupt())
        playback = Playback(process, writer, script.compressed, interrupt.check)
        stack.enter_context(closing(playback))
        playback.wait_until_ready(READY_S)
        script.perform(playback, writer)
        playback.wait_for_answers(ALL_ANSWERS_S)
        process.stop(EXIT_S)
        return playback.answers


def _node_arguments(config: Config, compressed: bool, scratch: Path) -> list[str]:
    file = scratch / 'parameters.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': config.nested()}}))
    transport = 'compressed' if compressed else 'raw'
    return ['--params-file', str(file), '-p', f'image_transport:={transport}']
