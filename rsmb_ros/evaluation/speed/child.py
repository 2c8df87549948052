"""What only a process of its own can tell: `python -m rsmb_ros.evaluation.speed.child JOB ...`."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path
from time import perf_counter

KIB = 1024


def main(arguments: list[str]) -> None:
    """Do `memory FILE.npz` or `start`, configuration as JSON on stdin; JSON on stdout."""
    settings = json.load(sys.stdin)
    job, *rest = arguments
    found = memory(rest[0], settings) if job == 'memory' else start(settings)
    print(json.dumps(found))


def memory(pair: str, settings: dict[str, object]) -> dict[str, int]:
    """
    Measure the memory of one reference and one live frame, arrays of an .npz file.

    Returns
    -------
    dict
        `idle`: with kernels loaded and both images read [bytes]; `peak`: above it, for good
        measure over two frames [bytes].

    """
    import numpy as np

    from rsmb_ros.core import Config, Detector, warm_up

    config = Config().replaced(settings)
    warm_up(config)
    with np.load(pair) as images:
        reference, live = images['reference'], images['live']
    with suppress(OSError):
        Path('/proc/self/clear_refs').write_text('5')  # peak so far: of loading the kernels
    idle = _status('VmRSS')
    detector = Detector(reference, config=config)
    for _ in range(2):
        detector.detect(live)
    # not ru_maxrss: a child takes it over from its parent
    return {'idle': idle, 'peak': _status('VmHWM') - idle}


def start(settings: dict[str, object]) -> dict[str, float]:
    """Time the import of the core and `warm_up`, kernels from wherever numba finds them [s]."""
    begin = perf_counter()
    from rsmb_ros.core import Config, warm_up

    imported = perf_counter()
    warm_up(Config().replaced(settings))
    return {'imports': imported - begin, 'warm_up': perf_counter() - imported}


def _status(name: str) -> int:
    """Return a line of /proc/self/status [bytes]."""
    lines = Path('/proc/self/status').read_text().splitlines()
    return next(int(line.split()[1]) * KIB for line in lines if line.startswith(f'{name}:'))


if __name__ == '__main__':
    main(sys.argv[1:])
