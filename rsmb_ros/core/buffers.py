"""Large arrays that are used again: fresh memory costs several times what filling it does."""

from __future__ import annotations

import weakref

import numpy as np


class Buffers:
    """Arrays float32 that are lent to objects for as long as those live."""

    def __init__(self) -> None:
        self._free: dict[tuple[int, ...], list[np.ndarray]] = {}

    def lend(self, owner: object, shape: tuple[int, ...]) -> np.ndarray:
        """Return an array that nobody else uses while `owner` lives; what it holds is left over."""
        free = self._free.setdefault(shape, [])
        try:
            array = free.pop()
        except IndexError:
            array = np.empty(shape, np.float32)
        weakref.finalize(owner, free.append, array).atexit = False
        return array
