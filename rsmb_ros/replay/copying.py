"""The inputs of a replay, copied into its output."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.recording import BagFrame, is_reference
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import ConfigError

from .recorded import PREFIX

_LARGE = 4 << 20  # bytes that may wait for the next frame


class Copier:
    """
    Copies messages up to each frame, byte by byte, at the time they were recorded.

    Reading and writing are apart: SQLite reads only in the thread that opened the file.

    Of the live topic those frames are copied that gave a result; of the others everything up to
    the last frame.

    Parameters
    ----------
    bag : Bag
        Of ROS 2; it is opened once more, to be read beside the frames.
    live : str
        Topic of the frames.
    others : sequence of str
        References, camera_info and the like.

    Raises
    ------
    ConfigError
        If one of the topics has the name of an output.
    BagError
        If the bag is of ROS 1.

    """

    def __init__(self, bag: Bag, live: str, others: Sequence[str]) -> None:
        for name in (live, *others):
            if name.startswith(PREFIX):
                raise ConfigError(
                    f'--keep-input: topic {name} of {bag.path} has the name of an output; '
                    f'rename it, or leave --keep-input away: names below {PREFIX} are ours'
                )
        self._bag = Bag(bag.path, bag.damage)
        self._live = live
        self._types = {topic.name: topic.type for topic in self._bag.topics}
        self._latched = {topic.name for topic in self._bag.topics if is_reference(topic)}
        self._collected: deque[list[tuple[str, int, bytes]]] = deque()
        try:
            self._messages = self._bag.cdr(live, *others)
            self._next = next(self._messages, None)
        except Exception:
            self._bag.close()
            raise

    def collect(self, frame: BagFrame) -> None:
        """Read what was recorded before a frame, and the frame; in the thread that made this."""
        found = []
        while self._next is not None and self._next[1] <= frame.log_time_ns:
            topic, time_ns, data = self._next
            if data and (topic != self._live or time_ns == frame.log_time_ns):  # empty: damaged
                found.append(self._next)
            self._next = next(self._messages, None)
        self._collected.append(found)

    def write(self, writer: BagWriter | None) -> None:
        """Write what was collected for the oldest frame; without a writer pass over it."""
        for topic, time_ns, data in self._collected.popleft():
            if writer is not None:
                writer.write_cdr(topic, self._types[topic], data, time_ns, topic in self._latched)
                writer.flush(_LARGE)

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()
