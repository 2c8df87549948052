"""
Throughput of `rsmb batch` with one and two workers, and the cost of a 1080p frame.

Prints the tables of BATCH.md; run as ``python benchmarks/batch.py --rounds 3`` from the root.
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
from dataclasses import dataclass
from pathlib import Path

RSMB = (sys.executable, '-m', 'rsmb_ros.cli.main')
WAYS = {  # how the same bags are replayed
    '1 worker, 1 thread': ('--workers', '1', '--set', 'worker.threads=1'),
    '1 worker, 2 threads': ('--workers', '1'),  # cores shared out: all of them
    '2 workers, 1 thread each': ('--workers', '2'),
}
FULL_HD = '1920x1080'


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


def throughput(folder: Path, bags: int, frames: int, rounds: int) -> None:
    """Replay the same bags in each way, in turns."""
    for n in range(bags):
        flight(folder / 'in' / f'{n}.mcap', '640x480', frames, n)
    costs: dict[str, list[Cost]] = {way: [] for way in WAYS}
    run('batch', folder / 'in' / '0.mcap', '-o', folder / 'warm')  # compiles
    for number in range(rounds):
        for way, options in WAYS.items():
            out = folder / 'out'
            shutil.rmtree(out, ignore_errors=True)
            costs[way].append(run('batch', folder / 'in', '-o', out, *options))
            print(f'round {number + 1}, {way}: {costs[way][-1]}', file=sys.stderr, flush=True)
    total = bags * frames
    print('| way | frames/s, median | least - most | CPU s / frame | x 1 worker, 1 thread |')
    print('| --- | ---: | ---: | ---: | ---: |')
    for way, found in costs.items():
        rates = sorted(total / cost.seconds for cost in found)
        base = [cost.seconds for cost in costs[next(iter(WAYS))]]
        times = [one / cost.seconds for one, cost in zip(base, found, strict=True)]
        cpu = statistics.median(cost.cpu for cost in found) / total
        print(
            f'| {way} | {statistics.median(rates):.2f} | {rates[0]:.2f} - {rates[-1]:.2f} '
            f'| {cpu:.3f} | {statistics.median(times):.2f} ({min(times):.2f} - {max(times):.2f}) |'
        )


def full_hd(folder: Path, rounds: int) -> None:
    """Measure a worker on 1080p frames; what starting costs is taken off."""
    bag, out = flight(folder / 'hd.mcap', FULL_HD, 6, 3), folder / 'hd-out.mcap'
    costs: dict[int, list[Cost]] = {2: [], 6: []}
    for _ in range(rounds):
        for frames, found in costs.items():
            limit = ('--max-frames', frames)
            found.append(run('replay', bag, '-o', out, '--set', 'worker.threads=1', *limit))
    cpu = [(more.cpu - few.cpu) / 4 for few, more in zip(costs[2], costs[6], strict=True)]
    print(f'\n{FULL_HD}, one thread, outputs included')
    print(f'* CPU: {statistics.median(cpu):.2f} s a frame ({min(cpu):.2f} - {max(cpu):.2f})')
    start = statistics.median(cost.cpu for cost in costs[2]) - 2 * statistics.median(cpu)
    print(f'* start: {start:.1f} s CPU a process')
    read, written = (path.stat().st_size / 6e6 for path in (bag, out))
    print(f'* read {read:.2f} MB, written {written:.1f} MB a frame')
    code = (
        'import resource, sys; from pathlib import Path\n'
        'from rsmb_ros.replay.job import ReplayJob, replay\n'
        'replay(ReplayJob(Path(sys.argv[1]), Path(sys.argv[2]), threads=1))\n'
        'print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)\n'
    )
    peak = subprocess.check_output([sys.executable, '-c', code, bag, out], text=True)
    print(f'* peak memory: {peak.strip()} MiB a worker')


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
