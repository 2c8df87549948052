"""What tests of the replay share: the size and times of a small flight, and its masks."""

import numpy as np

from rsmb_ros.bags.reading import Bag

ROWS, COLS = 96, 128
START_NS = 1_700_000_000_000_000_000
STEP_NS = 250_000_000


def masks_of(path):
    """Return the change masks of a replay by stamp [ns]."""
    with Bag(path) as bag:
        return {frame.time_ns: frame.image for frame in bag.frames('/rsmb/change_mask')}


def equal_masks(some, others):
    """Whether two series of masks are equal, whatever their stamps."""
    pairs = list(zip(some.values(), others.values(), strict=True))
    return bool(pairs) and all(np.array_equal(one, other) for one, other in pairs)
