"""Frames of a bag to results."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator

import numpy as np

from rsmb_ros.bags.reading import Bag, BagFrame, Topic
from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.errors import BagError, FrameError
from rsmb_ros.core.types import Result

# Returns the result of a frame that is known already.
Known = Callable[[BagFrame], Result | None]

_log = logging.getLogger(__name__)


def unknown(frame: BagFrame) -> Result | None:
    """Know no frame."""
    return None


def results(
    bag: Bag,
    live: Topic,
    reference: np.ndarray | Topic,
    config: Config,
    depth: np.ndarray | None,
    known: Known = unknown,
) -> Iterator[tuple[BagFrame, np.ndarray, Result]]:
    """
    Iterate over frames, the reference of each, and results; a newer reference takes over.

    `depth` is that of the only reference; a frame that is `known` is not processed again.
    """
    focal_px = bag.focal_px()
    camera = None if focal_px is None else Camera(focal_px)
    topics = [live.name]
    if isinstance(reference, Topic):
        topics.append(reference.name)
        image = next((frame.image for frame in bag.frames(reference.name)), None)
        if image is None:
            raise BagError(f'{bag.path}: no image of {reference.name} can be read')
        bag.skipped.clear()  # they will be met, and counted, once more
    else:
        image = reference
    detector = Detector(image, camera, config, depth)
    for frame in bag.frames(*topics):
        if frame.topic != live.name:
            if not np.array_equal(frame.image, detector.reference):
                if depth is not None:
                    raise BagError(
                        f'{bag.path}: image {frame.index} of {frame.topic} is another reference '
                        'than the one --depth describes; give one with --reference FILE'
                    )
                detector = Detector(frame.image, camera, config)
            continue
        try:
            result = known(frame) or detector.detect(frame.image, frame.stamp_ns or None)
        except FrameError as error:
            bag.skipped[live.name] += 1
            _log.warning('%s: frame %d of %s skipped: %s', bag.path, frame.index, live.name, error)
            continue
        yield frame, detector.reference, result
