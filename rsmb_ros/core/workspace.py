"""Arrays that are used again, so that frame after frame allocates nothing large."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import DTypeLike


class Workspace:
    """Arrays by name; asking again for one, of whatever shape, voids what it held."""

    def __init__(self) -> None:
        self._memory: dict[str, np.ndarray] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> np.ndarray:
        """Return an array of that shape with anything in it."""
        count = math.prod(shape)
        memory = self._memory.get(name)
        if memory is None or memory.size < count or memory.dtype != dtype:
            memory = self._memory[name] = np.zeros(count, dtype)
        return memory[:count].reshape(shape)


class Workspaces:
    """Workspaces that are lent one by one, as many as there are users at a time."""

    def __init__(self) -> None:
        self._idle: deque[Workspace] = deque()  # whose ends are safe between threads

    @contextmanager
    def lent(self) -> Iterator[Workspace]:
        """Lend a workspace to a ``with`` block."""
        try:
            room = self._idle.pop()
        except IndexError:
            room = Workspace()
        try:
            yield room
        finally:
            self._idle.append(room)
