"""Each live frame with what it is compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsmb_ros.bags.recording import BagFrame, NoMore, Recording, Topic
from rsmb_ros.core.errors import BagError

from .selection import Picker


@dataclass(frozen=True)
class Reference:
    """One of the references of a replay."""

    number: int  # from 0, in the order they were used
    image: np.ndarray  # (M, N) or (M, N, 3) uint8


Pairs = Iterator[tuple[BagFrame, Reference]]


def pairs(
    recording: Recording,
    live: Topic,
    reference: np.ndarray | Topic,
    picker: Picker,
    only_one: bool = False,
) -> Pairs:
    """
    Iterate over the picked frames of `live`; a newer image of a reference topic takes over.

    Frames before the first reference are compared with that one.

    Raises
    ------
    BagError
        If no reference can be read, or there is another one although `only_one` is asked for.

    """
    names = [live.name]
    if isinstance(reference, Topic):
        names.append(reference.name)
        image = next((frame.image for frame in recording.frames(reference.name)), None)
        if image is None:
            raise BagError(f'{recording.path}: no image of {reference.name} can be read')
        recording.skipped.clear()  # they will be met, and counted, once more
    else:
        image = reference
    current = Reference(0, image)
    try:
        for frame in recording.frames(*names, wanted=picker):
            if frame.topic == live.name:
                yield frame, current
            elif not np.array_equal(frame.image, current.image):
                if only_one:
                    raise BagError(
                        f'{recording.path}: image {frame.index} of {frame.topic} is another '
                        'reference than the one --depth describes; give one with --reference FILE'
                    )
                current = Reference(current.number + 1, frame.image)
    except NoMore:
        return
