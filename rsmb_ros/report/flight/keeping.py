"""What to keep of a stream whose end is not known: bounded, and the same for equal streams."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar('T')


class Thinned(Generic[T]):
    """
    Evenly spaced items of a stream, the first among them; from half of `most` to `most`.

    Parameters
    ----------
    most : int
        When one more would be kept, every second one is dropped, and from then on not taken.

    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._step = 1
        self._kept: list[T] = []
        self.offered = 0

    def offer(self, make: Callable[[], T]) -> None:
        """Meet the next item, which is only made when it is kept."""
        number, self.offered = self.offered, self.offered + 1
        if number % self._step:
            return
        if len(self._kept) == self._most:
            self._kept, self._step = self._kept[::2], 2 * self._step
            if number % self._step:
                return
        self._kept.append(make())

    def __iter__(self):
        return iter(self._kept)

    def __len__(self) -> int:
        return len(self._kept)


class Highest(Generic[T]):
    """The `most` items of a stream with the highest scores; of equal ones the earlier."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._heap: list[tuple[float, int, T]] = []
        self._offered = 0

    def offer(self, score: float, make: Callable[[], T]) -> None:
        """Meet the next item, which is only made when it is kept."""
        self._offered += 1
        key = (score, -self._offered)
        if len(self._heap) < self._most:
            heapq.heappush(self._heap, (*key, make()))
        elif key > self._heap[0][:2]:
            heapq.heapreplace(self._heap, (*key, make()))

    def __iter__(self):
        return (item for _, _, item in sorted(self._heap, key=lambda one: -one[1]))

    def __len__(self) -> int:
        return len(self._heap)
