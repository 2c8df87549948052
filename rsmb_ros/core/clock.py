"""Where the time of one frame goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Clock:
    """Times the steps of one frame; a step that is taken twice adds up."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the block as step `name`."""
        begin = time.perf_counter()
        yield
        spent = 1e3 * (time.perf_counter() - begin)
        self.timings_ms[name] = self.timings_ms.get(name, 0.0) + spent
