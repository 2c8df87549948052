"""A foreign process streams images: no output of a processed frame is lost."""

import os
import re
import subprocess
import sys
from pathlib import Path

CLIENT = Path(__file__).with_name('stream_client.py')


def test_stream_loses_no_output_of_a_processed_frame(start_node):
    start_node().wait_for_log('ready: ', 60.0)
    options = ['--seconds', '4', '--hz', '10', '--width', '320', '--height', '240']
    done = subprocess.run(
        [sys.executable, str(CLIENT), *options],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=300.0,  # s, includes compiling every kernel
        check=False,
    )
    assert done.returncode == 0, done.stderr
    processed, dropped = (
        int(re.search(rf"'{name}': (\d+)", done.stdout).group(1))
        for name in ('processed', 'dropped')
    )
    assert processed > 0
    assert processed + dropped <= 40
    assert re.search(r'latency .* p50 \d+ ms', done.stdout)
