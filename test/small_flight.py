"""What tests of the replay share: the size and times of a small flight, and its masks."""

import numpy as np

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter

ROWS, COLS = 96, 128
START_NS = 1_700_000_000_000_000_000
STEP_NS = 250_000_000


def flown(path, factory, photos):
    """Write a bag: the first of some photos as the reference, the others live, 4 Hz; its path."""
    with BagWriter(path) as bag:
        for n, photo in enumerate(photos):
            time_ns = START_NS + n * STEP_NS
            header = factory.header(time_ns, 'cam')
            topic = '/image' if n else '/reference/image'
            bag.write(topic, factory.image(header, photo), time_ns)
    return path


def masks_of(path):
    """Return the change masks of a replay by stamp [ns]."""
    with Bag(path) as bag:
        return {frame.time_ns: frame.image for frame in bag.frames('/rsmb/change_mask')}


def equal_masks(some, others):
    """Whether two series of masks are equal, whatever their stamps."""
    pairs = list(zip(some.values(), others.values(), strict=True))
    return bool(pairs) and all(np.array_equal(one, other) for one, other in pairs)
