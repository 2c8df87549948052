"""`rsmb evaluate`: accuracy and time on suites or folders with truth, rivals beside ours."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from rsmb_ros.core import warm_up
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import ConfigError, FileProblem
from rsmb_ros.evaluation.case import Case
from rsmb_ros.evaluation.ours import NAME
from rsmb_ros.evaluation.results import LEGEND, Results, outcome_line
from rsmb_ros.evaluation.run import KNOWN_METHODS, methods_of, run_case, settings_of
from rsmb_ros.evaluation.suites import NUISANCES, SUITES, Wish
from rsmb_ros.report.html import Report

from .images import output_folder, write_png, write_whole
from .options import add_config_options, data_folder, frame_size, load_config, within
from .progress import progress
from .truth_folder import cases_in, count_in

ALL_METHODS = 'all'


@dataclass(frozen=True)
class _Source:
    """Where cases come from."""

    name: str
    count: int
    cases: Iterator[Case]
    settings: Mapping[str, object]  # known of the camera, for ours
    frequencies: tuple[str, ...] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.epilog = f'Suites: {"; ".join(f"{s.name}: {s.about}" for s in SUITES.values())}.'
    parser.add_argument(
        'targets',
        nargs='+',
        metavar='SUITE|DIR',
        help='names of suites, or folders as `rsmb synth -o DIR` makes them',
    )
    parser.add_argument(
        '--methods',
        default=ALL_METHODS,
        metavar='NAME,...',
        help=f'of {", ".join(KNOWN_METHODS)}; default: {ALL_METHODS}',
    )
    parser.add_argument('--report', type=Path, metavar='OUT.html', help='page; OUT.json beside it')
    parser.add_argument('--markdown', type=Path, metavar='OUT.md', help='tables as markdown')
    parser.add_argument('--sheets', type=Path, metavar='DIR', help='pictures of the worst cases')
    parser.add_argument(
        '--size', type=frame_size, metavar='COLSxROWS', help="of the frames; default: the suite's"
    )
    parser.add_argument('--first', type=within(int, 1, 10_000), help='so many cases of each only')
    parser.add_argument(
        '--nuisances',
        choices=NUISANCES,
        default=NUISANCES[0],
        help="of the camera: the suite's own, none, or those of `planar`",
    )
    parser.add_argument('--data', type=Path, metavar='DIR', help='real pictures; else RSMB_DATA')
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Measure, print the tables, write what is asked for."""
    config = load_config(args)
    asked = KNOWN_METHODS if args.methods == ALL_METHODS else args.methods.split(',')
    names = list(dict.fromkeys(asked))
    methods = methods_of(names, config)
    _check_outputs(args)
    sources = [_source(target, args) for target in args.targets]
    called = [source.name for source in sources]
    if len(set(called)) < len(called):  # their cases could not be told apart
        raise ConfigError(f'two of {", ".join(args.targets)} have the same name')
    shown = NAME if NAME in names else names[0]
    about = {'suites': ' '.join(args.targets), 'nuisances': args.nuisances}
    results = Results(shown, {method.name: method.source for method in methods}, about)
    if NAME in names:
        warm_up(config)  # compiling is no part of a frame
    with suppress(KeyboardInterrupt):  # what was measured until then is worth having
        _measure(sources, names, config, results)
    if results.scores:
        print(results.as_text())
        _write(results, sources, args)
    total = sum(source.count for source in sources)
    done = len(results.scores) // len(names)
    if done < total:
        print(f'interrupted: {done} of {total} cases')
        raise KeyboardInterrupt
    return 0


def _check_outputs(args: argparse.Namespace) -> None:
    """Refuse before hours of work what could not be written after them."""
    if args.report is not None and args.report.suffix != '.html':
        raise ConfigError(f'--report {args.report}: must end in .html')
    for path in (args.report, args.markdown):
        if path is not None and not path.parent.is_dir():
            raise FileProblem(f'{path}: cannot be written: no folder {path.parent}')


def _source(target: str, args: argparse.Namespace) -> _Source:
    if target in SUITES:
        suite = SUITES[target]
        wish = Wish(args.size, args.nuisances, data_folder(args.data), args.first)
        suite.check(wish)
        count = min(suite.size, args.first or suite.size)
        settings = settings_of(suite, args.nuisances)
        return _Source(target, count, suite.cases(wish), settings, suite.frequencies)
    folder = Path(target)
    if not folder.exists():
        raise ConfigError(
            f'{target!r} is neither a suite nor a folder; suites: {", ".join(SUITES)}'
        )
    count = count_in(folder)
    first = min(count, args.first or count)
    for _ in islice(cases_in(folder), first):  # a bad folder is refused before any work
        pass
    return _Source(folder.resolve().name, first, islice(cases_in(folder), first), {})


def _measure(sources: list[_Source], names: list[str], config: Config, results: Results) -> None:
    pairs = (
        (case, methods_of(names, config, source.settings))
        for source in sources
        for case in source.cases
    )
    total = sum(source.count for source in sources)
    for case, methods in progress(pairs, total, 'evaluate'):
        results.add(run_case(case, methods))


def _write(results: Results, sources: list[_Source], args: argparse.Namespace) -> None:
    sheets = results.sheets()
    if args.report:
        report = Report('rsmb evaluate', len(sheets), full=len(sheets), legend=LEGEND)
        for index, (score, sheet) in enumerate(sheets):
            report.add(index, score.case, outcome_line(score), {'contact sheet': sheet})
        statics = results.static_table()
        tables = [*results.tables(), *([statics] if statics else [])]
        report.write(args.report, results.summary(), tables)
        write_whole(args.report.with_suffix('.json'), results.as_json().encode())
    if args.markdown:
        frequencies = {source.name: source.frequencies for source in sources}
        write_whole(args.markdown, results.as_markdown(frequencies).encode())
    if args.sheets:
        folder = output_folder(args.sheets)
        for score, sheet in sheets:
            write_png(folder / f'{score.case.replace("/", "_").replace(" ", "-")}.png', sheet)
