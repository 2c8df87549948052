"""Whether a recording is whole: every message read, checksum compared, image decoded."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from .opening import open_recording
from .reading import Bag
from .recording import Recording


@dataclass(frozen=True)
class Checked:
    """What a check found."""

    damaged: bool
    lines: list[str]  # for people: one a topic, then what is damaged


def check(path: Path) -> Checked:
    """
    Read a recording to its end.

    Raises
    ------
    BagError
        If it cannot be opened at all.

    """
    with open_recording(path) as recording:
        read, broken = _read(recording)
        notes = list(recording.damage.notes)
        lines = []
        for topic in recording.topics:
            good = read[topic.name]
            bad = broken[topic.name] + recording.skipped[topic.name]
            missing = max(0, topic.count - good - bad)
            text = f'{topic.name} ({topic.type}): {good} of {topic.count} messages whole'
            text += f', {bad} cannot be read' if bad else ''
            lines.append(text + (f', {missing} missing' if missing else ''))
            if bad or missing:
                notes.append(f'{path}: {text}')
        lines += recording.damage.unchecked
    return Checked(bool(notes), [*lines, *recording.damage.notes])


def _read(recording: Recording) -> tuple[Counter[str], Counter[str]]:
    """Read every message; returns how many of each topic are whole, and how many are not."""
    read: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    images = [topic.name for topic in recording.topics if topic.is_image]
    for frame in recording.frames(*images) if images else ():
        read[frame.topic] += 1
    if isinstance(recording, Bag):
        for topic in recording.topics:
            if not topic.is_image and topic.count:
                whole, bad = recording.readable(topic.name)
                read[topic.name] += whole
                broken[topic.name] += bad
    return read, broken
