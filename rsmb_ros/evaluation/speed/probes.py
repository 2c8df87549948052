"""Memory and start-up, measured in processes that do nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rsmb_ros
from rsmb_ros.core import Config

from ..metrics import NAN
from .flights import TimedFlight

DEADLINE = 900  # s; compiling every kernel takes one minute, on a busy machine some
STARTS = 4  # the first compiles
_PROC = Path('/proc/self/status')


@dataclass(frozen=True)
class Memory:
    """Of a process that registers frames of one size, NaN where the system does not tell."""

    shape: tuple[int, int]
    idle: float  # with kernels loaded and the images read [bytes]
    peak: float  # above that, reference and two frames [bytes]


@dataclass(frozen=True)
class StartUp:
    """Time until the first frame can come."""

    cached: bool  # kernels were on the disk
    imports: float  # [s]
    warm_up: float  # compiling or loading the kernels [s]


def peak_memory(flight: TimedFlight, config: Config) -> Memory:
    """Measure with the last frame of a flight; a layered one has most in it."""
    if not _PROC.exists():
        return Memory(flight.shape, NAN, NAN)
    with tempfile.TemporaryDirectory(prefix='rsmb') as folder:
        pair = Path(folder) / 'pair.npz'
        np.savez(pair, reference=flight.reference, live=flight.live[-1])
        return Memory(flight.shape, **_child(config, 'memory', str(pair)))


def start_ups(config: Config) -> Iterator[StartUp]:
    """Start with a kernel cache of its own: once it is empty, then it is filled."""
    with tempfile.TemporaryDirectory(prefix='rsmb') as folder:
        for n in range(STARTS):
            yield StartUp(n > 0, **_child(config, 'start', NUMBA_CACHE_DIR=folder))


def _child(config: Config, *arguments: str, **environment: str) -> dict[str, float]:
    """Run `speed.child` with this package, return what it says."""
    root = str(Path(rsmb_ros.__file__).parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH', '')]))
    done = subprocess.run(
        [sys.executable, '-m', 'rsmb_ros.evaluation.speed.child', *arguments],
        input=json.dumps(config.flat()),
        env={**os.environ, 'PYTHONPATH': path, **environment},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=DEADLINE,
    )
    return json.loads(done.stdout)
