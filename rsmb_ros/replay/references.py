"""Which topic is replayed, and what it is compared with."""

from __future__ import annotations

import re
from contextlib import ExitStack
from decimal import Decimal
from pathlib import Path

import numpy as np

from rsmb_ros.bags import video
from rsmb_ros.bags.image_files import read_image
from rsmb_ros.bags.opening import open_recording
from rsmb_ros.bags.recording import Label, NoMore, Recording, Topic
from rsmb_ros.core.errors import BagError, ConfigError

from .selection import seconds

RECORDINGS = ('.mcap', '.db3', '.bag', *video.SUFFIXES)
BESIDE = 5 * 10**8  # ns that a stamp may lie before the first frame or after the last


def choose(
    recording: Recording, named: str | None, topic: str | None
) -> tuple[Topic, np.ndarray | Topic]:
    """
    Return the live topic, and the reference or its topic.

    Parameters
    ----------
    recording : Recording
    named : str, optional
        The reference: an image file, a topic whose newest image counts, or one frame, written
        ``@WHICH``, ``TOPIC@WHICH``, ``FILE@WHICH`` or ``FILE:TOPIC@WHICH``. WHICH is an index
        from 0, or a stamp in seconds with a decimal point; the nearest frame is taken. None: the
        topic that is named as a reference.
    topic : str, optional
        The live images; None: the only topic it may be.

    """
    if named is None:
        found = recording.guess_reference()
        return _live(recording, topic, found.name), found
    if Path(named).is_file():
        if Path(named).suffix.lower() in RECORDINGS:
            raise ConfigError(
                f'--reference {named} is a recording: say which frame, for example {named}@0'
            )
        return _live(recording, topic, None), read_image(Path(named))
    if '@' in named:
        return _live(recording, topic, None), _one_frame(recording, named, topic)
    try:
        found = recording.image_topic(named)
    except BagError as error:
        raise BagError(f'--reference {named} is neither a file nor a topic: {error}') from error
    return _live(recording, topic, found.name), found


def _live(recording: Recording, topic: str | None, taken: str | None) -> Topic:
    live = recording.image_topic(topic) if topic else recording.guess_live(taken)
    if live.name == taken:
        raise ConfigError(
            f'--topic and --reference are both {taken}; must be two topics, or one frame of it: '
            f'--reference {taken}@0'
        )
    return live


def _one_frame(recording: Recording, named: str, topic: str | None) -> np.ndarray:
    """Return the image that ``...@WHICH`` names."""
    where, _, which = named.rpartition('@')
    if not re.fullmatch(r'\d+|\d+\.\d*', which):
        raise ConfigError(
            f'--reference {named}: {which!r} after @ must be an index, 0 for the first frame, or '
            'a stamp in seconds with a decimal point, such as 12.5'
        )
    with ExitStack() as stack:
        file, name = _parts(where)
        if file is not None:
            recording = stack.enter_context(open_recording(file))
            found = recording.image_topic(name) if name else recording.guess_live(None)
        else:
            found = recording.image_topic(name) if name else _live(recording, topic, None)
        try:
            return _image_at(recording, found, which)
        finally:
            recording.skipped.clear()  # what was met will be met, and counted, once more


def _parts(where: str) -> tuple[Path | None, str]:
    """Split ``FILE:TOPIC``, either of which may be missing."""
    if not where:
        return None, ''
    if Path(where).exists():
        return Path(where), ''
    file, colon, topic = where.rpartition(':')
    if colon:
        if not Path(file).exists():
            raise BagError(f'--reference {where}@...: {file}: no such file or folder')
        return Path(file), topic
    return None, where


def _image_at(recording: Recording, topic: Topic, which: str) -> np.ndarray:
    where = f'{recording.path}: --reference {topic.name}@{which}'
    if '.' in which:
        index = _nearest(recording, topic, int(Decimal(which) * 10**9), where)
    else:
        index = int(which)
        if index >= topic.count:
            raise BagError(f'{where}: the frames of the topic are 0 to {topic.count - 1}')
    frames = recording.frames(topic.name, wanted=lambda label: _only(label, index))
    try:
        return next(frames).image
    except (NoMore, StopIteration):
        raise BagError(f'{where}: message {index} cannot be read; choose another frame') from None


def _only(label: Label, index: int) -> bool:
    if label.index > index:
        raise NoMore
    return label.index == index


def _nearest(recording: Recording, topic: Topic, stamp_ns: int, where: str) -> int:
    """Return the index of the frame whose stamp is nearest; the earlier one of two."""
    times: list[tuple[int, int]] = []

    def note(label: Label) -> bool:
        times.append((label.time_ns, label.index))
        if label.time_ns > stamp_ns:
            raise NoMore
        return False

    try:
        for _ in recording.frames(topic.name, wanted=note):
            raise AssertionError('no frame was wanted')
    except NoMore:
        pass
    if not times:
        raise BagError(f'{where}: no image of {topic.name} can be read')
    first, last = min(times)[0], max(times)[0]
    if not first - BESIDE <= stamp_ns <= last + BESIDE:
        raise BagError(
            f'{where}: the stamp must be from {seconds(first)} on, and not after the last '
            f'frame, met: {seconds(last)}'
        )
    return min(times, key=lambda one: (abs(one[0] - stamp_ns), one[1]))[1]
