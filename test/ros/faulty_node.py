"""
The real node, but for a detector that a frame can make slow or raise: pixel (0, 0) says how.

Run like `rsmb_node`. SLOW: detects after `SLOW_S`; BROKEN: raises.
"""

import sys
import time

SLOW, BROKEN = 7, 13  # grey levels of pixel (0, 0)
SLOW_S = 3.0


def disturb(detect):
    """Return `detect` with the faults."""

    def disturbed(self, live, stamp=None):
        mark = int(live[0, 0]) if live.ndim == 2 else 0
        if mark == BROKEN:
            raise ValueError('a frame that breaks the detector')
        if mark == SLOW:
            time.sleep(SLOW_S)
        return detect(self, live, stamp)

    return disturbed


if __name__ == '__main__':
    from rsmb_ros.core import Detector
    from rsmb_ros.ros.main import main

    Detector.detect = disturb(Detector.detect)
    sys.exit(main())
