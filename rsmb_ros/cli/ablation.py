"""`rsmb ablation`: what each part of the method is worth, switched off alone."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from rsmb_ros.core import Config, warm_up
from rsmb_ros.core.errors import ConfigError, FileProblem
from rsmb_ros.evaluation.ablation.measure import STREAMS, Measured, ablated, streamed
from rsmb_ros.evaluation.ablation.results import AblationResults
from rsmb_ros.evaluation.ablation.switches import SWITCHES, Switch
from rsmb_ros.evaluation.suites import SUITES, Suite, Wish

from .images import write_whole
from .options import add_config_options, data_folder, load_config, within
from .progress import narrated

TARGETS = ('planar:8', 'layered:12', 'nochange:12')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    known = '; '.join(f'{one.name}: {one.instead}' for one in SWITCHES)
    parser.epilog = f'What can be switched off: {known}.'.replace('%', '%%')
    parser.add_argument(
        'targets',
        nargs='*',
        default=TARGETS,
        metavar='SUITE[:CASES]',
        help=f'suites of `rsmb evaluate`; default: {" ".join(TARGETS)}',
    )
    parser.add_argument(
        '--only', metavar='NAME,...', help='switch off only these; default: one after the other'
    )
    parser.add_argument(
        '--stream',
        type=within(int, 0, 10_000),
        default=30,
        metavar='FRAMES',
        help='of each stream, for persistence; 0 = none; default: %(default)s',
    )
    parser.add_argument('--markdown', type=Path, metavar='OUT.md', help='tables as markdown')
    parser.add_argument('--data', type=Path, metavar='DIR', help='real pictures; else RSMB_DATA')
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Measure, print the tables, write what is asked for."""
    config = load_config(args).for_one_frame()
    if args.markdown is not None and not args.markdown.parent.is_dir():
        raise FileProblem(f'{args.markdown}: cannot be written: no folder {args.markdown.parent}')
    switches = _switches(args.only)
    suites = [_suite(target, args) for target in args.targets]
    total = sum(wish.first or suite.size for suite, wish in suites) + len(STREAMS) * args.stream
    about = {'suites': ' '.join(args.targets), 'frames of a stream': args.stream}
    results = AblationResults(about)
    done = 0
    for one in [config, *(config.replaced(switch.settings) for switch in switches)]:
        warm_up(one)  # compiling is no part of a frame
    with suppress(KeyboardInterrupt):  # what was measured until then is worth having
        found: Iterator[Measured] = narrated(
            _measured(suites, switches, args.stream, config), total, 'ablation'
        )
        for measured in found:
            results.add(measured)
            done += 1
    if done:
        print(results.as_text())
        if args.markdown:
            write_whole(args.markdown, results.as_markdown().encode())
    if done < total:
        print(f'interrupted: {done} of {total} cases')
        raise KeyboardInterrupt
    return 0


def _switches(only: str | None) -> list[Switch]:
    known = {one.name: one for one in SWITCHES}
    names = list(known) if only is None else list(dict.fromkeys(only.split(',')))
    for name in names:
        if name not in known:
            raise ConfigError(f'{name!r} cannot be switched off: known are {", ".join(known)}')
    return [known[name] for name in names]


def _suite(target: str, args: argparse.Namespace) -> tuple[Suite, Wish]:
    name, _, first = target.partition(':')
    if name not in SUITES:
        raise ConfigError(f'{name!r} is not a suite; suites: {", ".join(SUITES)}')
    suite = SUITES[name]
    try:
        count = int(first) if first else suite.size
    except ValueError:
        count = 0
    if not 1 <= count <= suite.size:
        raise ConfigError(f'{target!r}: {first!r} cases, must be 1 to {suite.size}')
    wish = Wish(data=data_folder(args.data), first=count)
    suite.check(wish)
    return suite, wish


def _measured(
    suites: list[tuple[Suite, Wish]], switches: list[Switch], frames: int, config: Config
) -> Iterator[Measured | str]:
    """Yield each case and each frame, before it what is being done."""
    for suite, wish in suites:
        yield f'cases of {suite.name}'
        for case in suite.cases(wish):
            yield case.name
            yield ablated(case, config, suite.settings, switches)
    for name in STREAMS if frames else ():
        yield name
        yield from streamed(name, frames, config)
