"""Ctrl-C at a moment of our choice."""

from __future__ import annotations

import signal
from types import FrameType, TracebackType


class Interrupt:
    """
    Remembers SIGINT while its block runs; a context manager for the main thread.

    An exception out of nowhere would spoil a record that is half written, or leave a lock of rclpy
    held for ever.
    """

    def __init__(self) -> None:
        self._made = False

    def __enter__(self) -> Interrupt:
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        signal.signal(signal.SIGINT, self._before)

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self._made:
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._made = True
