"""On what something was measured."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path

import rsmb_ros

_LIBRARIES = ('numpy', 'numba', 'opencv-python-headless', 'scipy', 'scikit-image')


def environment() -> dict[str, str]:
    """Return machine and versions, by name."""
    return {
        'machine': f'{_processor()}, {_cores()} cores, {platform.machine()}, {platform.system()}',
        'rsmb_ros': rsmb_ros.__version__,
        'Python': platform.python_version(),
        **{name: _version(name) for name in _LIBRARIES},
    }


def _processor() -> str:
    """Return the processor's name where the system tells it."""
    try:
        lines = Path('/proc/cpuinfo').read_text('utf-8').splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.processor() or 'unknown processor'


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 0


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return 'installed otherwise'
