"""
Load of the node: a camera faster than it, for some minutes; what is lost, late or left in memory.

    python test/ros/load.py --case 640x480@60 --case 1920x1080@30 --seconds 300

Prints a table (Markdown). Exit code: 0 all bounds are kept, 1 one is not, or no answer.
"""

import argparse
import itertools
import statistics
import sys
import tempfile
import time
from pathlib import Path

from flight import Trouble, flight

from rsmb_ros.core.errors import RsmbError
from rsmb_ros.messages.outputs import OUTPUTS, ROWS

STOP_S = 5.0
PROBE_S = 3.0
MOST_GROWTH_MB = 20.0
_WINDOW = 10  # samples, one a second


def percentile(values, percent):
    """Return the nearest-rank percentile."""
    ranked = sorted(values)
    return ranked[min(len(ranked) - 1, int(percent / 100 * len(ranked)))]


def losses(listener, sent, counts):
    """Return what contradicts 'each processed frame exactly once, under its own stamp'."""
    wrong = []
    if counts['received'] != counts['processed'] + counts['dropped']:
        wrong.append(f'counters do not add up: {counts}')
    if counts['received'] > len(sent):
        wrong.append(f'{counts["received"]} received of {len(sent)} sent')
    for output in OUTPUTS:
        stamps = listener.stamps[output.name]
        if listener.counts[output.name] != counts['processed']:
            wrong.append(
                f'{output.name}: {listener.counts[output.name]} for {counts["processed"]} frames'
            )
        if output.type == ROWS:
            continue
        if repeated := sum(times > 1 for times in stamps.values()):
            wrong.append(f'{output.name}: {repeated} stamps more than once')
        if strange := len(stamps.keys() - set(sent)):
            wrong.append(f'{output.name}: {strange} stamps of no frame')
        if stamps.keys() != listener.stamps['regions_json'].keys():
            wrong.append(f'{output.name}: other frames than regions_json')
    return wrong


def memory_mb(samples, settle_s):
    """Return what the node held after settling and at the end, and its peak since, medians [MB]."""
    begin = samples[0][0] + settle_s
    after = [memory for moment, memory, *_ in samples if moment >= begin]
    first, last = after[:_WINDOW], after[-_WINDOW:]
    return statistics.median(first), statistics.median(last), max(after)


def fly(case, seconds, settle_s, folder):
    """Run one case; return a row of the table and what is wrong."""
    size, hz = case.split('@')
    with flight(folder, (), ('--size', size, '--hz', hz)) as flown:
        listener = flown.listener
        with listener.probe():
            flown.wait(PROBE_S)
        begin_s, skip = time.monotonic(), len(listener.latencies_s)
        flown.wait(seconds)
        took_s = time.monotonic() - begin_s
        latencies, arrivals = listener.latencies_s[skip:], listener.arrivals_s[skip:]
        sent = flown.camera.stop()
        flown.wait_until_idle()
        counts = listener.node_counts()
        flown.wait_until(
            lambda: all(listener.counts[output.name] >= counts['processed'] for output in OUTPUTS),
            'complete outputs',
        )
        flown.node.stop(STOP_S)
        wrong = losses(listener, sent, counts)
    if len(arrivals) < 2:
        raise Trouble(f'{len(arrivals)} answers in {took_s:.0f} s')
    cycle_s = percentile([b - a for a, b in itertools.pairwise(arrivals)], 95)
    transport_s, latency_s = percentile(listener.transport_s, 95), percentile(latencies, 95)
    bound_s = 2 * cycle_s + 2 * transport_s
    if latency_s > bound_s:
        wrong.append(f'latency p95 {latency_s:.2f} s, bound {bound_s:.2f} s')
    settled, end, peak = memory_mb(flown.samples, settle_s)
    if end - settled >= MOST_GROWTH_MB:
        wrong.append(f'memory grew by {end - settled:.0f} MB')
    row = {
        'case': f'{size} bgr8 at {hz} Hz',
        's': f'{took_s:.0f}',
        'sent': len(sent),
        **counts,
        'answers/s': f'{len(arrivals) / took_s:.2f}',
        'latency p50 / p95 [s]': f'{percentile(latencies, 50):.2f} / {latency_s:.2f}',
        'frame in work p95 [s]': f'{cycle_s:.2f}',
        'transport p95 [ms]': f'{1e3 * transport_s:.0f}',
        'memory settled / end / peak [MB]': f'{settled:.0f} / {end:.0f} / {peak:.0f}',
    }
    return row, wrong


def print_table(rows):
    """Print rows as Markdown."""
    print('| ' + ' | '.join(rows[0]) + ' |')
    print('|' + '---|' * len(rows[0]))
    for row in rows:
        print('| ' + ' | '.join(map(str, row.values())) + ' |')


def main():
    """Parse, fly, report."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--case', action='append', help='WIDTHxHEIGHT@HZ, may be repeated')
    parser.add_argument('--seconds', type=float, default=300.0, help='of each case')
    parser.add_argument('--settle', type=float, default=60.0, help='s until memory is compared')
    options = parser.parse_args()
    if not 0 <= options.settle < options.seconds:
        parser.error(f'--settle {options.settle:g} must be from 0 to --seconds')
    rows, wrong = [], []
    for case in options.case or ['640x480@60', '1920x1080@30']:
        with tempfile.TemporaryDirectory() as folder:
            try:
                row, losses_ = fly(case, options.seconds, options.settle, Path(folder))
            except (Trouble, RsmbError) as error:
                wrong.append(f'{case}: {error}')
                continue
        rows.append(row)
        wrong += [f'{case}: {loss}' for loss in losses_]
    if rows:
        print_table(rows)
    for line in wrong:
        print(f'wrong: {line}', file=sys.stderr)
    return 1 if wrong else 0


if __name__ == '__main__':
    sys.exit(main())
