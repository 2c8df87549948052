"""Which frames of a recording are replayed."""

from __future__ import annotations

from dataclasses import dataclass

from rsmb_ros.bags.recording import Label, NoMore
from rsmb_ros.core.errors import ConfigError

ABSOLUTE = 10**8 * 10**9  # ns; times from here on (1973) are stamps, those before it offsets
SLACK = 5 * 10**9  # ns; stamps may be so much out of order at the end of what is wanted


@dataclass(frozen=True)
class Selection:
    """
    Part of the live frames.

    Times below 1e8 s count from the first live frame, others are stamps; both ends belong to it.

    Raises
    ------
    ConfigError
        If a value is out of range.

    """

    start_ns: int | None = None  # [ns]
    end_ns: int | None = None  # [ns]
    stride: int = 1  # every so many frames, the first one of the range among them
    max_frames: int | None = None

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise ConfigError(f'--stride {self.stride} must be at least 1')
        if self.max_frames is not None and self.max_frames < 1:
            raise ConfigError(f'--max-frames {self.max_frames} must be at least 1')
        start, end = self.start_ns, self.end_ns
        for name, value in (('start', start), ('end', end)):
            if value is not None and value < 0:
                raise ConfigError(f'--{name} {seconds(value)} must not be below 0 s')
        if start is not None and end is not None:
            both = (start < ABSOLUTE) == (end < ABSOLUTE)
            if both and end < start:
                raise ConfigError(f'--end {seconds(end)} is before --start {seconds(start)}')

    def at_most(self, count: int) -> int:
        """Return how many of `count` frames there are to come, at most."""
        taken = -(-count // self.stride)
        return taken if self.max_frames is None else min(taken, self.max_frames)

    def expected(self, count: int, span_ns: tuple[int, int] | None) -> int:
        """Return about how many of `count` frames, spread evenly over a time [ns], are taken."""
        if span_ns is None or span_ns[1] <= span_ns[0]:
            return self.at_most(count)
        length = span_ns[1] - span_ns[0]
        first, last = 0, length
        if self.start_ns is not None:
            first = self._offset(self.start_ns, span_ns[0])
        if self.end_ns is not None:
            last = min(length, self._offset(self.end_ns, span_ns[0]))
        return self.at_most(max(1, round(count * max(0, last - first) / length)))

    @staticmethod
    def _offset(value: int, first_ns: int) -> int:
        return max(0, value if value < ABSOLUTE else value - first_ns)


class Picker:
    """Tells the wanted frames of one run over a recording; those of other topics all are."""

    def __init__(self, selection: Selection, topic: str) -> None:
        self._selection = selection
        self._topic = topic
        self._first_ns: int | None = None
        self._last_ns = 0
        self._met = 0  # in the range of time
        self._taken = 0

    def __call__(self, label: Label) -> bool:
        """Return whether to read a frame; raises `NoMore` when no other one will be wanted."""
        if label.topic != self._topic:
            return True
        chosen, time_ns = self._selection, label.time_ns
        if self._first_ns is None:
            self._first_ns = self._last_ns = time_ns
        self._last_ns = max(self._last_ns, time_ns)
        if chosen.max_frames is not None and self._taken == chosen.max_frames:
            raise NoMore
        end = self._absolute(chosen.end_ns)
        if end is not None and time_ns > end:
            if time_ns > end + SLACK:
                raise NoMore
            return False
        start = self._absolute(chosen.start_ns)
        if start is not None and time_ns < start:
            return False
        self._met += 1
        if (self._met - 1) % chosen.stride:
            return False
        self._taken += 1
        return True

    def check(self) -> None:
        """
        Say why nothing was picked.

        Raises
        ------
        ConfigError
            If there were frames, and none in the range of time.

        """
        if self._first_ns is None or self._taken:
            return
        start, end = self._selection.start_ns, self._selection.end_ns
        wanted = ' '.join(
            f'--{name} {seconds(value)}'
            for name, value in (('start', start), ('end', end))
            if value is not None
        )
        length = seconds(self._last_ns - self._first_ns)
        first, last = seconds(self._first_ns), seconds(self._last_ns)
        raise ConfigError(
            f'{wanted}: no frame of {self._topic}; its frames lie from 0 s to {length}, '
            f'stamps from {first} to {last}'
        )

    def _absolute(self, value: int | None) -> int | None:
        if value is None or value >= ABSOLUTE:
            return value
        return value + (self._first_ns or 0)


def seconds(time_ns: int) -> str:
    """Return a time in seconds, every digit of it."""
    whole, rest = divmod(time_ns, 10**9)
    return f'{whole}.{rest:09d}'.rstrip('0').rstrip('.') + ' s'
