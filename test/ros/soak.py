"""
Soak of the node: a fault every few seconds, for half an hour; it goes on, and leaves nothing.

    python test/ros/soak.py --seconds 1800 --every 4

Stops by itself. Prints two tables (Markdown). Exit code: 0 all is well, 1 something is not.
"""

import argparse
import itertools
import random
import signal
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from flight import Trouble, flight

from rsmb_ros.core.errors import RsmbError
from rsmb_ros.messages.outputs import OUTPUTS

RECOVERY_S = 30.0  # until there are answers again
STOP_S = 5.0
FROZEN_S = 2.0
JUMP_S = 3600.0
MOST_SILENCE_S = 10.0  # of diagnostics, which come once a second
MOST_GROWTH_MB, MOST_THREADS, MOST_FILES = 30.0, 2, 10  # more than after settling
_WINDOW = 10  # samples, one a second
_ALWAYS = 'change_mask'  # the output whose subscriber stays
MALFORMED_SENT = 10  # by the camera in one burst
_MALFORMED = 'malformed messages'
_ANSWERS = 2  # the first one may have been in work when the fault came


class Soak:
    """Injects faults into a flight and waits until it goes on."""

    def __init__(self, flown, seed):
        self._flown = flown
        self._random = random.Random(seed)
        self._away = set()  # names of outputs we do not subscribe to
        self._jump_s = JUMP_S
        self._waiting = []
        self.recoveries_s = defaultdict(list)  # of each fault
        self.faults = {
            _MALFORMED: lambda: flown.camera.tell('malformed'),
            'frames of another size': lambda: flown.camera.tell('size'),
            'another reference': lambda: flown.camera.tell('reference'),
            'subscribers come and go': self._churn,
            'camera stopped and continued': self._freeze,
            'clock jumps an hour': self._jump,
        }

    def inject(self):
        """Inject one of the faults; each comes before any comes again."""
        if not self._waiting:
            self._waiting = self._random.sample(sorted(self.faults), len(self.faults))
        name = self._waiting.pop()
        answers = self._flown.listener.counts
        self.faults[name]()
        begin_s, before = time.monotonic(), answers[_ALWAYS]
        self._flown.wait_until(
            lambda: answers[_ALWAYS] >= before + _ANSWERS,
            f'answer after: {name}',
            RECOVERY_S,
        )
        self.recoveries_s[name].append(time.monotonic() - begin_s)

    def _churn(self):
        for output in OUTPUTS:
            if output.name == _ALWAYS or self._random.random() < 0.3:
                continue
            if output.name in self._away:
                self._flown.listener.listen(output)
            else:
                self._flown.listener.leave(output)
            self._away ^= {output.name}

    def _freeze(self):
        process = self._flown.camera.process
        process.send_signal(signal.SIGSTOP)
        try:
            self._flown.wait(FROZEN_S)
        finally:
            process.send_signal(signal.SIGCONT)

    def _jump(self):
        self._flown.camera.tell(f'clock {self._jump_s}')
        self._jump_s = -self._jump_s


def verdict(flown, malformed_bursts, settled, end):
    """Return what is wrong after all that."""
    listener, wrong = flown.listener, []
    counts, values = listener.node_counts(), listener.states[-1][3]
    if counts['received'] != counts['processed'] + counts['dropped']:
        wrong.append(f'counters do not add up: {counts}')
    if 'dropped: exception' in values:
        wrong.append(f'{values["dropped: exception"]} exceptions')
    if values['worker alive'] != 'true':
        wrong.append('the worker has ended')
    if flown.node.said(r'ERROR|Traceback'):
        wrong.append('errors in the log')
    malformed, sent = int(values['malformed messages']), MALFORMED_SENT * malformed_bursts
    if malformed < sent / 2:  # best effort: some may be lost
        wrong.append(f'{malformed} malformed messages counted, {sent} sent')
    for name, most, before, after in zip(
        ('memory [MB]', 'threads', 'open files'),
        (MOST_GROWTH_MB, MOST_THREADS, MOST_FILES),
        settled,
        end,
        strict=True,
    ):
        if after - before > most:
            wrong.append(f'{name} grew from {before:.0f} to {after:.0f}, at most {most:g} more')
    if (silence := longest_silence_s(listener)) > MOST_SILENCE_S:
        wrong.append(f'no diagnostics for {silence:.1f} s')
    return wrong


def longest_silence_s(listener):
    """Return the longest time between two diagnostics."""
    moments = [state[0] for state in listener.states]
    return max(b - a for a, b in itertools.pairwise(moments))


def held(samples):
    """Return medians of memory [MB], threads and open files."""
    return [statistics.median(column) for column in list(zip(*samples, strict=True))[1:]]


def report(flown, soak, took_s, settled, end):
    """Print the tables."""
    print('| fault | times | answers again after p50 / max [s] |\n|---|---|---|')
    for name, recoveries in sorted(soak.recoveries_s.items()):
        median, longest = statistics.median(recoveries), max(recoveries)
        print(f'| {name} | {len(recoveries)} | {median:.2f} / {longest:.2f} |')
    listener = flown.listener
    values = listener.states[-1][3]
    rows = {
        'duration [s]': f'{took_s:.0f}',
        **{f'frames {name}': number for name, number in listener.node_counts().items()},
        'malformed messages': values['malformed messages'],
        'references received': values['references received'],
        'memory settled / end / peak [MB]': f'{settled[0]:.0f} / {end[0]:.0f} / '
        f'{max(sample[1] for sample in flown.samples):.0f}',
        'threads settled / end': f'{settled[1]:.0f} / {end[1]:.0f}',
        'open files settled / end': f'{settled[2]:.0f} / {end[2]:.0f}',
        'longest silence of diagnostics [s]': f'{longest_silence_s(listener):.1f}',
    }
    print('\n| whole soak | |\n|---|---|')
    for name, value in rows.items():
        print(f'| {name} | {value} |')


def run(options, folder):
    """Fly and inject; return what is wrong."""
    node = ('-p', 'use_sim_time:=true')
    camera = ('--size', '320x240', '--hz', '20', '--clock')
    with flight(folder, node, camera) as flown:
        soak = Soak(flown, options.seed)
        begin_s = time.monotonic()
        settled = None
        while (now := time.monotonic()) < begin_s + options.seconds:
            soak.inject()
            flown.wait(max(now + options.every - time.monotonic(), 0.1))
            if settled is None and now > begin_s + options.settle:
                settled = held(flown.samples[-_WINDOW:])
        took_s = time.monotonic() - begin_s
        flown.camera.stop()
        flown.wait_until_idle()
        end = held(flown.samples[-_WINDOW:])
        settled = settled or end
        bursts = len(soak.recoveries_s[_MALFORMED])
        wrong = verdict(flown, bursts, settled, end)
        report(flown, soak, took_s, settled, end)
        flown.node.stop(STOP_S)
    return wrong


def main():
    """Parse, soak, report."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--seconds', type=float, default=1800.0)
    parser.add_argument('--every', type=float, default=4.0, help='s from one fault to the next')
    parser.add_argument('--settle', type=float, default=60.0, help='s until memory is compared')
    parser.add_argument('--seed', type=int, default=20170301)
    options = parser.parse_args()
    if not 0 <= options.settle < options.seconds:
        parser.error(f'--settle {options.settle:g} must be from 0 to --seconds')
    with tempfile.TemporaryDirectory() as folder:
        try:
            wrong = run(options, Path(folder))
        except (Trouble, RsmbError) as error:
            wrong = [str(error)]
    for line in wrong:
        print(f'wrong: {line}', file=sys.stderr)
    return 1 if wrong else 0


if __name__ == '__main__':
    sys.exit(main())
