"""`rsmb play`: the images of a bag on ROS topics, for whoever listens."""

from __future__ import annotations

import argparse
import os
import re
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from rsmb_ros.bags.pacing import Moment, paced
from rsmb_ros.bags.reading import CAMERA_INFO, Bag, Topic
from rsmb_ros.bags.recording import is_reference, is_truth
from rsmb_ros.core.errors import BagError, ConfigError

from .interrupt import Interrupt
from .options import frame_rate, require_ros, within

if TYPE_CHECKING:
    from rsmb_ros.ros.player import Player

_NAME = re.compile(r'/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='rosbag2 folder, .mcap or .db3')
    parser.add_argument(
        '--rate',
        type=frame_rate,
        metavar='HZ',
        help='live frames per second; default: as recorded',
    )
    parser.add_argument(
        '--topic', metavar='NAME', help='what --rate counts; else the topic named image'
    )
    parser.add_argument(
        '--remap',
        type=_remap,
        action='append',
        default=[],
        metavar='FROM:=TO',
        help='publish the topic FROM of the bag as TO; repeatable',
    )
    parser.add_argument(
        '--now', action='store_true', help='stamp messages with the present time, not the recorded'
    )
    parser.add_argument('--loop', action='store_true', help='start again at the end, until Ctrl-C')
    parser.add_argument(
        '--wait',
        type=within(float, 0.0, 3600.0),
        default=10.0,
        metavar='S',
        help='seconds to wait for a listener to each topic before the first message (default: 10)',
    )


def run(args: argparse.Namespace) -> int:
    """Play, and say in one line what was played."""
    require_ros()
    if args.topic and not args.rate:
        raise ConfigError('--topic says what --rate counts: give both or none')
    with Bag(args.bag) as bag:
        topics = {t.name: t.type for t in bag.topics if t.count and _is_played(bag, t.name)}
        if not any(bag.topic(name).is_image for name in topics):
            raise BagError(f'{args.bag}: there is no image to play')
        names = _names(args, topics)
        live = _live(bag, args) if args.rate else None
        played, took_s = _play(bag, args, topics, names, live)
    told = ', '.join(names[topic] for topic in topics)
    print(f'played {played} messages in {took_s:.1f} s: {told}')
    return 0


def _is_played(bag: Bag, name: str) -> bool:
    """Whether it is input of a node: images and camera_info, and no truth."""
    topic = bag.topic(name)
    return (topic.is_image or topic.type == CAMERA_INFO) and not is_truth(topic)


def _is_kept(topic: Topic) -> bool:
    """Whether late listeners are to have it as well: a reference and its depth."""
    return is_reference(topic) or topic.name.split('/')[-2:] == ['reference', 'depth']


def _live(bag: Bag, args: argparse.Namespace) -> str:
    return (bag.image_topic(args.topic) if args.topic else bag.guess_live(None)).name


def _names(args: argparse.Namespace, topics: dict[str, str]) -> dict[str, str]:
    """Return the name each topic of the bag is published under."""
    names = {topic: topic for topic in topics}
    for old, new in args.remap:
        if f'/{old.lstrip("/")}' not in {f'/{topic.lstrip("/")}' for topic in topics}:
            raise ConfigError(
                f'--remap {old}:={new}: {old} is not played; played are {", ".join(topics)}'
            )
        (found,) = (topic for topic in topics if topic.lstrip('/') == old.lstrip('/'))
        names[found] = new
    if len(set(names.values())) < len(names):
        raise ConfigError(f'--remap: two topics of the bag would become one: {names}')
    return names


def _play(
    bag: Bag,
    args: argparse.Namespace,
    topics: dict[str, str],
    names: dict[str, str],
    live: str | None,
) -> tuple[int, float]:
    """Return how many messages were played, and for how long [s]."""
    from rsmb_ros.ros.player import Player
    from rsmb_ros.ros.transport import apply_profile

    apply_profile(os.environ, Path.cwd())
    latched = {names[topic] for topic in topics if _is_kept(bag.topic(topic))}
    kinds = {names[topic]: kind for topic, kind in topics.items()}
    with Interrupt() as interrupt, closing(Player(kinds, latched, interrupt.check)) as player:
        _wait_for_listeners(player, list(kinds), args.wait)
        start_s, played = time.monotonic(), 0
        for moments in _turns(bag, args, list(topics), live):
            played += _play_once(player, moments, names, args.now)
        took_s = time.monotonic() - start_s
        # what was sent last is to arrive before the publishers go
        player.spin_until(time.monotonic() + 0.5)
    return played, took_s


def _turns(
    bag: Bag, args: argparse.Namespace, topics: list[str], live: str | None
) -> Iterator[Iterator[Moment]]:
    yield paced(bag.cdr(*topics), live, args.rate)
    while args.loop:
        yield paced(bag.cdr(*topics), live, args.rate)


def _play_once(player: Player, moments: Iterator[Moment], names: dict[str, str], now: bool) -> int:
    from rsmb_ros.ros.player import restamped, stamp_of

    start_s, played = time.monotonic(), 0
    stamps: dict[int, int] = {}  # recorded -> played: what belongs together by stamp stays so
    for moment in moments:
        player.spin_until(start_s + moment.offset_s)
        for topic, data in moment.messages:
            if now:
                data = restamped(data, stamps.setdefault(stamp_of(data), time.time_ns()))
            player.publish(names[topic], data)
            played += 1
    return played


def _wait_for_listeners(player: Player, topics: list[str], timeout_s: float) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not all(map(player.listeners, topics)) and time.monotonic() < deadline_s:
        player.spin_once()
    deaf = [topic for topic in topics if not player.listeners(topic)]
    if deaf:
        print(f'nobody listens to {", ".join(deaf)}; playing all the same', flush=True)


def _remap(text: str) -> tuple[str, str]:
    old, between, new = text.partition(':=')
    if not between or not _NAME.fullmatch(old) or not _NAME.fullmatch(new):
        raise argparse.ArgumentTypeError(f'{text!r} must be FROM:=TO, two names of topics')
    return old, new
