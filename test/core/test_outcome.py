"""What one frame says alone, and with the memory of those before, adds up to `detect`."""

import pickle

import numpy as np
import pytest

from rsmb_ros.core import Config, Detector
from rsmb_ros.core.outcome import remembered
from rsmb_ros.core.persistence import RegionMemory
from rsmb_ros.core.settled import settled

LASTING = {'change.persistence_frames': 3, 'change.persistence_seen': 2}
IMAGES = ('change_mask', 'valid_mask', 'residual', 'registered', 'rectified', 'row_motion')


@pytest.fixture(scope='module')
def frames(texture_of):
    """Reference and four frames; a patch that is there in the second to the fourth."""
    ground = texture_of(120, 150, 11)
    found = [ground[10:106, 10:138]]
    for n, (dx, dy) in enumerate(((2, 0), (-1, 1), (0, -2), (3, 1))):
        frame = ground[10 + dy : 106 + dy, 10 + dx : 138 + dx].copy()
        if n:
            frame[40 - dy : 62 - dy, 50 - dx : 78 - dx] = 245
        found.append(frame)
    return found


@pytest.mark.parametrize('changes', [{}, LASTING])
def test_alone_and_remembered_is_detect(frames, changes):
    config = Config().replaced(changes)
    whole, alone = Detector(frames[0], config=config), Detector(frames[0], config=config)
    memory = RegionMemory(config.change)
    reported = []
    for stamp, frame in enumerate(frames[1:], 1):
        wanted = whole.detect(frame, stamp)
        found = remembered(alone.detect_alone(frame), memory, stamp)
        assert found.regions == wanted.regions
        for name in IMAGES:
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
        reported.append(len(found.changes))
    # with a memory not before it is seen for the second time
    assert reported == ([0, 0, 1, 1] if changes else [0, 1, 1, 1])
    assert not len(alone._regions)


def test_settled_result_travels_and_says_the_same(frames):
    outcome = Detector(frames[0]).detect_alone(frames[2])
    sent = pickle.loads(pickle.dumps(settled(outcome.result)))
    assert sent.timings_ms == {}
    assert sent.regions == outcome.result.regions
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(sent, name), getattr(outcome.result, name))


def test_frame_that_is_not_registered_leaves_the_memory_alone(frames):
    config = Config().replaced(LASTING)
    memory = RegionMemory(config.change)
    outcome = Detector(frames[0], config=config).detect_alone(np.full_like(frames[1], 90))
    result = remembered(outcome, memory, 1)
    assert (outcome.path, result.status) == (None, 'not_registered')
    assert settled(result).registered.shape == frames[1].shape
