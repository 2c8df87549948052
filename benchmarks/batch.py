"""
Throughput of `rsmb batch` on one and two cores, and the cost of a 1080p frame.

Prints the tables of BATCH.md; run as ``python benchmarks/batch.py --rounds 3`` from the root, on an
idle machine of two cores.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

RSMB = (sys.executable, '-m', 'rsmb_ros.cli.main')
ONE, TWO, IN_TURN = 'batch, 1 worker', 'batch, 2 workers', 'replay, in turn, all cores'
FULL_HD = '1920x1080'
HD_FRAMES = 6
# How long frames take and how long their detection, both from the end of the first to that of the
# last detection: as many frames are read and written in that time as are detected.
PROFILE = """
import resource, sys, time
from pathlib import Path
import cv2
from rsmb_ros.core import Detector
from rsmb_ros.replay.job import ReplayJob, replay
spans, detect = [], Detector.detect
def timed(self, *given):
    start = time.perf_counter()
    result = detect(self, *given)
    spans.append((start, time.perf_counter()))
    return result
Detector.detect = timed
threads = int(sys.argv[3]) or None
if threads:
    cv2.setNumThreads(threads)
replay(ReplayJob(Path(sys.argv[1]), Path(sys.argv[2]), threads=threads))
total = spans[-1][1] - spans[0][1]
detected = sum(end - start for start, end in spans[1:])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
print(total / len(spans[1:]), detected / len(spans[1:]), peak)
"""


@dataclass(frozen=True)
class Cost:
    """Of one command and its processes."""

    seconds: float  # wall-clock
    cpu: float  # [s], user and system


def run(*arguments: str | Path | int) -> Cost:
    """Run `rsmb` and measure it."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*RSMB, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(seconds, cpu)


def flight(path: Path, size: str, frames: int, seed: int) -> Path:
    """Make a bag, unless it is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        run('synth', '-o', path, '--size', size, '--frames', frames, '--seed', seed)
    return path


def ways(folder: Path, bags: int) -> dict[str, Callable[[], Cost]]:
    """Return how the same bags are replayed; each time all outputs are written anew."""

    def batch(workers: int) -> Cost:
        return run('batch', folder / 'in', '-o', fresh(folder / 'out'), '--workers', workers)

    def in_turn() -> Cost:
        out = fresh(folder / 'out')
        threads = ('--set', f'worker.threads={os.cpu_count()}')
        one = [
            run('replay', folder / 'in' / f'{n}.mcap', '-o', out / f'{n}.mcap', *threads)
            for n in range(bags)
        ]
        return Cost(sum(cost.seconds for cost in one), sum(cost.cpu for cost in one))

    return {ONE: partial(batch, 1), TWO: partial(batch, 2), IN_TURN: in_turn}


def fresh(folder: Path) -> Path:
    """Return the folder, empty."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def throughput(folder: Path, bags: int, frames: int, rounds: int) -> None:
    """Replay the same bags in each way, in turns."""
    fresh(folder / 'in')
    for n in range(bags):
        made = flight(folder / 'made' / f'{frames}-{n}.mcap', '640x480', frames, n)
        (folder / 'in' / f'{n}.mcap').hardlink_to(made)
    run('batch', folder / 'in' / '0.mcap', '-o', fresh(folder / 'out'))  # compiles
    costs: dict[str, list[Cost]] = {ONE: [], TWO: [], IN_TURN: []}
    for number in range(rounds):
        for way, replayed in ways(folder, bags).items():
            costs[way].append(replayed())
            print(f'round {number + 1}, {way}: {costs[way][-1]}', file=sys.stderr, flush=True)
    print(f'{bags} bags of {frames} frames, 640x480, {rounds} rounds in turns\n')
    print('| way | frames/s, median | least - most | cores used | CPU s / frame | x 1 worker |')
    print('| --- | ---: | ---: | ---: | ---: | ---: |')
    for way, found in costs.items():
        rates = [bags * frames / cost.seconds for cost in found]
        times = [one.seconds / cost.seconds for one, cost in zip(costs[ONE], found, strict=True)]
        cores = [cost.cpu / cost.seconds for cost in found]
        cpu = [cost.cpu / bags / frames for cost in found]
        print(
            f'| {way} | {statistics.median(rates):.2f} | {min(rates):.2f} - {max(rates):.2f} '
            f'| {statistics.median(cores):.2f} | {statistics.median(cpu):.3f} | {spread(times)} |'
        )


def full_hd(folder: Path, rounds: int) -> None:
    """Measure one core on 1080p frames, the writing in its thread and in one beside it."""
    bag, out = flight(folder / 'hd.mcap', FULL_HD, HD_FRAMES, 3), folder / 'hd-out.mcap'
    rows = {'one thread, as a worker of a batch': 1, 'as `rsmb replay`': 0}
    found: dict[str, list[list[float]]] = {way: [] for way in rows}
    for _ in range(rounds):
        for way, threads in rows.items():
            command = (sys.executable, '-c', PROFILE, bag, out, str(threads))
            start = resource.getrusage(resource.RUSAGE_CHILDREN)
            told = subprocess.check_output(command, text=True).split()
            end = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu = end.ru_utime + end.ru_stime - start.ru_utime - start.ru_stime
            found[way].append([*map(float, told), cpu / HD_FRAMES])
            print(f'{FULL_HD}, {way}: {found[way][-1]}', file=sys.stderr, flush=True)
    print(f'\n{FULL_HD}, {HD_FRAMES} frames, all outputs; CPU with start and first frame\n')
    print('| way | s / frame | reading and writing [%] | CPU s / frame | peak memory [MiB] |')
    print('| --- | ---: | ---: | ---: | ---: |')
    for way, values in found.items():
        share = spread([100 * (1 - detected / total) for total, detected, _, _ in values], 0)
        totals, peaks, cpu = (spread([one[n] for one in values], d) for n, d in _COLUMNS)
        print(f'| {way} | {totals} | {share} | {cpu} | {peaks} |')
    read, written = (path.stat().st_size / HD_FRAMES / 1e6 for path in (bag, out))
    print(f'\nRead {read:.2f} MB, written {written:.1f} MB a frame')


_COLUMNS = ((0, 2), (2, 0), (3, 2))  # place of a value, digits


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Return median, least and most for people."""
    middle, least, most = (
        f'{value:.{digits}f}' for value in (statistics.median(values), min(values), max(values))
    )
    return f'{middle} ({least} - {most})'


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--bags', type=int, default=8)
    parser.add_argument('--frames', type=int, default=10)
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--folder', type=Path, help='keeps the bags for the next time')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = args.folder or Path(name)
        print(f'load before: {os.getloadavg()[0]:.1f}', file=sys.stderr)
        throughput(folder, args.bags, args.frames, args.rounds)
        full_hd(folder, args.rounds)
        print(f'load after: {os.getloadavg()[0]:.1f}', file=sys.stderr)


if __name__ == '__main__':
    main()
