"""Waiting without sleeping: a thread that sleeps takes longer to wake than most work takes."""

from __future__ import annotations

import time

from numba import config, njit
from numba.core import types

from .geometry import OPTIONS

if config.DISABLE_JIT:

    def give_way():
        time.sleep(0.0)
else:
    # of the C library: lets another thread run that waits for this core
    give_way = types.ExternalFunction('sched_yield', types.int32())


@njit(**OPTIONS)
def changed(bell, heard, turns):
    """Say whether bell[0] is no longer `heard`, which is looked at `turns` times."""
    for _ in range(turns):
        if bell[0] != heard:
            return True
        give_way()
    return bell[0] != heard
