"""Messages of many chunks in the order of their times, with few chunks in memory."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple


class Entry(NamedTuple):
    """One message; compares by time, then by its place in the file."""

    time_ns: int
    chunk: int  # number of the chunk in the file
    at: int  # place in the chunk [byte]
    channel: int
    data: memoryview


Load = Callable[[int], Iterable[Entry]]


def by_time(starts_ns: Iterable[tuple[int, int]], load: Load) -> Iterator[Entry]:
    """
    Iterate over the messages of chunks by time.

    Parameters
    ----------
    starts_ns : iterable of (int, int)
        Time of each chunk's first message, or before, and its number.
    load : callable
        Number to messages; is called once for each chunk, and not before its time.

    """
    heap: list[Entry] = []
    for start_ns, number in sorted(starts_ns):
        while heap and heap[0].time_ns < start_ns:
            yield heapq.heappop(heap)
        for entry in load(number):
            heapq.heappush(heap, entry)
    while heap:
        yield heapq.heappop(heap)
