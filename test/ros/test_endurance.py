"""The scripts behind `make load` and `make soak`, for seconds instead of half an hour."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no topics to test')

HERE = Path(__file__).parent
RUN_S = 400.0  # includes compiling every kernel


def run(name, *options):
    """Return what a script prints; fail where it does."""
    done = subprocess.run(
        [sys.executable, str(HERE / name), *options],
        capture_output=True,
        text=True,
        timeout=RUN_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_every_processed_frame_of_a_stream_is_published_once():
    said = run('load.py', '--case', '320x240@20', '--seconds', '4', '--settle', '1')
    row = said.splitlines()[-1].split(' | ')
    assert row[0] == '| 320x240 bgr8 at 20 Hz'
    sent, received, processed, dropped = map(int, row[2:6])
    assert sent >= received == processed + dropped
    assert processed > 0


def test_node_goes_on_after_each_of_the_faults():
    said = run('soak.py', '--seconds', '14', '--every', '2', '--settle', '2')
    faults = re.findall(r'^\| ([a-z ]+) \| (\d+) \| [\d.]+ / [\d.]+ \|$', said, re.MULTILINE)
    assert len(faults) == 6, said
    assert all(int(times) > 0 for _, times in faults)
