"""What of a recording cannot be read; each loss is told once and counted."""

from __future__ import annotations

import logging
from collections.abc import Hashable

_log = logging.getLogger(__name__)


class Unreadable(Exception):
    """A file, or a part of it, is not what it should be; says why, not where."""


class Damage:
    """
    Losses of one recording, by place, however often it is read.

    A loss is a part of the file, not a single image: those are `Recording.skipped`.
    """

    def __init__(self) -> None:
        self._told: dict[Hashable, tuple[str, int]] = {}
        self.unchecked: list[str] = []  # what no checksum covers, for people

    def note(self, place: Hashable, text: str, lost: int = 0) -> None:
        """
        Remember a loss, and log it if it is new.

        Parameters
        ----------
        place : hashable
            Tells losses apart: file and offset.
        text : str
            Names the file, the place and what is wrong.
        lost : int
            Messages lost with it, as far as that is known.

        """
        if place not in self._told:
            self._told[place] = text, lost
            _log.warning('%s', text)

    def __bool__(self) -> bool:
        return bool(self._told)

    @property
    def notes(self) -> list[str]:
        """All that was told."""
        return [text for text, _ in self._told.values()]

    @property
    def lost(self) -> int:
        """Messages that are known to be lost."""
        return sum(lost for _, lost in self._told.values())
