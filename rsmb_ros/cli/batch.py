"""`rsmb batch`: many recordings, several at once; one that fails does not stop the others."""

from __future__ import annotations

import argparse
import os
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from rsmb_ros.batch.batch import SUFFIXES, Batch, BatchJob
from rsmb_ros.batch.cluster import ClusterCrew
from rsmb_ros.batch.crew import Crew, LocalCrew
from rsmb_ros.batch.items import Item, found_in, without_doubles
from rsmb_ros.batch.manifest import FAILED, Entry, only_batch
from rsmb_ros.batch.wishes import Content
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.replay.job import MOST_WORKERS

from .batch_list import beside, read_list
from .images import output_folder
from .interrupt import Interrupt
from .options import add_config_options, load_config, within
from .output_options import GEOJSON, add_content_options, add_geo_options, geo_options
from .progress import progress
from .replay import add_input_options, selection_of

_FILES = {
    'csv': 'NAME.csv: one line per region',
    'jsonl': 'NAME.jsonl: one line per frame',
    'report': 'NAME.html: page of what changed, for any browser, offline',
    'geojson': f'NAME.geojson: {GEOJSON}',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.epilog = (
        'Exit codes: 0 all done; 1 some failed, each with its reason; 2 bad usage. '
        'The same command again goes on: what is done is left, what failed is tried again.'
    )
    parser.add_argument(
        'bags',
        nargs='*',
        type=Path,
        metavar='BAG',
        help='recordings as for `rsmb replay`; a folder without metadata.yaml is searched for '
        '.mcap, .db3, .bag and rosbag2 folders, with all below it',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='DIR',
        help='folder for NAME.mcap of each recording, and manifest.json',
    )
    parser.add_argument(
        '--manifest',
        type=Path,
        metavar='FILE',
        help='.yaml or .csv list of recordings: bag, reference, topic, name, and what of the '
        'configuration is special about each; paths are relative to the file',
    )
    add_input_options(parser)
    add_content_options(parser, 'NAME.mcap')
    for name in SUFFIXES:
        parser.add_argument(f'--{name}', action='store_true', help=_FILES[name])
    add_geo_options(parser)
    parser.add_argument(
        '--workers',
        type=within(int, 1, MOST_WORKERS),
        metavar='N',
        help='cores to use; default: all. So many recordings at once, each on a core; where there '
        'are fewer recordings, the cores are shared out as threads of each, unless worker.threads '
        'is changed',
    )
    parser.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help="of a Dask cluster that does the work, tcp://HOST:PORT; needs 'rsmb_ros[batch]'",
    )
    parser.add_argument(
        '--again',
        action='store_true',
        help='replay what was done with another configuration, version or input; else it is left '
        'as it is, and told',
    )
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Replay what is not done, tell what became of it."""
    if args.scheduler and args.workers:
        raise ConfigError(
            f'--workers {args.workers} is for this machine; with --scheduler the cluster decides'
        )
    items = _items(args)
    content = Content(
        selection=selection_of(args),
        rate=args.rate,
        compress=args.compress,
        keep_input=args.keep_input,
        geo=geo_options(args, args.output / 'NAME.geojson' if args.geojson else None),
    )
    folder = output_folder(args.output)
    if args.scheduler:  # other machines have other working directories
        here = Path.cwd()
        items = [
            replace(item, source=item.source.absolute(), reference=beside(here, item.reference))
            for item in items
        ]
        folder = folder.absolute()
    job = BatchJob(
        items=items,
        folder=folder,
        workers=None if args.scheduler else args.workers or _cores(),
        content=content,
        beside=[name for name in SUFFIXES if getattr(args, name)],
        again=args.again,
    )
    with only_batch(folder):
        return _told(Batch(job), args.scheduler)


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def _items(args: argparse.Namespace) -> list[Item]:
    config = load_config(args)
    items = [
        Item(path, args.reference, args.topic, config=config)
        for given in args.bags
        for path in found_in(given, args.output)
    ]
    if args.manifest:
        items += read_list(args.manifest, Item(Path(), args.reference, args.topic, config=config))
    if not items:
        raise ConfigError('no recordings: name bags or folders, or list them in --manifest FILE')
    return without_doubles(items)


def _told(batch: Batch, scheduler: str | None) -> int:
    """Run the batch and print a line for each recording that is not on a terminal's bar."""
    for plan in batch.left:
        _complain(
            f'{plan.name}: left as it was done: {"; ".join(plan.differs)}; --again replays it'
        )
    start, entries = time.monotonic(), []
    plans = batch.to_do
    shown = sys.stderr.isatty()  # asked before the bar stands in for it
    if plans:
        crew: Crew = ClusterCrew(scheduler) if scheduler else LocalCrew(batch.job.workers or 1)
        try:
            with Interrupt() as interrupt, closing(batch.run(crew, interrupt.check)) as ended:
                for entry in progress(ended, len(plans), 'batch'):
                    entries.append(entry)
                    _tell(entry, shown)
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt('the same command goes on with the others') from error
    print(_summary(batch, entries, time.monotonic() - start))
    return int(bool(batch.left) or any(entry.status == FAILED for entry in entries))


def _tell(entry: Entry, on_bar: bool) -> None:
    if entry.counts is None:
        _complain(f'{entry.name}: failed: {entry.reason}')
    elif not on_bar:
        lost = f', {entry.counts.skipped} could not be read' if entry.counts.skipped else ''
        kept = f', {entry.counts.resumed} kept of before' if entry.counts.resumed else ''
        print(
            f'{entry.name}: done, {entry.counts.frames} frames{lost}{kept}, '
            f'{entry.counts.changes} changes, {entry.seconds:.1f} s',
            flush=True,
        )


def _complain(text: str) -> None:
    print(f'rsmb: error: {text}', file=sys.stderr, flush=True)


def _summary(batch: Batch, entries: list[Entry], seconds: float) -> str:
    done = [entry.counts for entry in entries if entry.counts is not None]
    frames = sum(counts.frames for counts in done)
    before = sum(plan.done for plan in batch.plans)
    parts = [f'{len(batch.plans)} recordings: {len(done)} done']
    parts += [f'{before} done before'] if before else []
    parts += [f'{len(entries) - len(done)} failed']
    parts += [f'{len(batch.left)} left as they were'] if batch.left else []
    speed = f'; {frames} frames in {seconds:.1f} s, {frames / seconds:.1f} frames/s' if done else ''
    return f'{", ".join(parts)}{speed} -> {batch.job.folder}'
