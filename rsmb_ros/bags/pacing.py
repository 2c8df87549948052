"""When each message of a recording is to be played."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple


class Moment(NamedTuple):
    """What is played at one time."""

    offset_s: float  # since the first moment
    messages: list[tuple[str, bytes]]  # topic, serialised message


def paced(
    stored: Iterable[tuple[str, int, bytes]], live: str | None = None, rate: float | None = None
) -> Iterator[Moment]:
    """
    Group messages by the time they were recorded at.

    Parameters
    ----------
    stored : iterable of (topic, log time [ns], serialised message)
        By log time, as `Bag.cdr` gives them.
    live : str, optional
        Topic of the frames that `rate` counts.
    rate : float, optional
        Frames a second; None: as recorded. What was recorded between two frames is then played
        with the later one.

    """
    frames, first_ns = 0, None
    for recorded_ns, group in groupby(stored, key=lambda message: message[1]):
        first_ns = recorded_ns if first_ns is None else first_ns
        messages = [(topic, data) for topic, _, data in group]
        offset_s = frames / rate if rate else (recorded_ns - first_ns) * 1e-9
        yield Moment(offset_s, messages)
        frames += sum(topic == live for topic, _ in messages)
