"""The inputs of a replay, copied into its output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.recording import BagFrame, is_reference
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import ConfigError

from .recorded import PREFIX

_LARGE = 4 << 20  # bytes that may wait for the next frame


class Copier:
    """
    Copies messages up to each frame, byte by byte, at the time they were recorded.

    Of the live topic those frames are copied that gave a result; of the others everything up to
    the last frame.

    Parameters
    ----------
    path : Path
        A ROS 2 bag.
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

    def __init__(self, path: Path, live: str, others: Sequence[str]) -> None:
        for name in (live, *others):
            if name.startswith(PREFIX):
                raise ConfigError(
                    f'--keep-input: topic {name} of {path} has the name of an output; '
                    f'rename it, or leave --keep-input away: names below {PREFIX} are ours'
                )
        self._bag = Bag(path)  # of its own: it runs beside the frames
        self._live = live
        self._types = {topic.name: topic.type for topic in self._bag.topics}
        try:
            self._messages = self._bag.cdr(live, *others)
            self._next = next(self._messages, None)
        except Exception:
            self._bag.close()
            raise

    def advance(self, frame: BagFrame, writer: BagWriter | None) -> None:
        """Copy what was recorded before a frame, and the frame; without a writer skip it."""
        while self._next is not None and self._next[1] <= frame.log_time_ns:
            topic, time_ns, data = self._next
            wanted = topic != self._live or time_ns == frame.log_time_ns
            if wanted and writer is not None:
                kind = self._types[topic]
                latched = any(is_reference(t) for t in self._bag.topics if t.name == topic)
                writer.write_cdr(topic, kind, data, time_ns, latched)
                writer.flush(_LARGE)
            self._next = next(self._messages, None)

    def close(self) -> None:
        """Close the bag."""
        self._bag.close()
