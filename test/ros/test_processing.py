"""The detector is rebuilt when, and only when, what it was built from has changed."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core import Camera, Config
from rsmb_ros.core.errors import FrameError
from rsmb_ros.messages.camera_info import Intrinsics
from rsmb_ros.ros import processing

IMAGE = np.zeros((48, 64), np.uint8)


@pytest.fixture
def built(monkeypatch):
    """Replace the detector by one that records what it was built from."""
    built = []

    class Recorder:
        def __init__(self, reference, camera, config, depth):
            if reference.shape[0] < 32:
                raise FrameError('too small')
            built.append(
                SimpleNamespace(reference=reference, camera=camera, config=config, depth=depth)
            )
            self.camera = camera

        def camera_for(self, width):
            return self.camera or Camera.guess(width)

        def detect(self, live, stamp=None):
            self.stamps = [*getattr(self, 'stamps', ()), stamp]
            return 'result'

    monkeypatch.setattr(processing, 'Detector', Recorder)
    return built


@pytest.fixture
def log():
    return []


@pytest.fixture
def process(built, log):
    return processing.Processing(Config(), log.append)


def test_frame_without_reference_has_no_result(process):
    assert process.detect(IMAGE) is None


def test_detector_is_built_once_for_a_reference(process, built):
    process.set_reference(IMAGE)
    assert len(built) == 1  # before the first frame needs it
    assert [process.detect(IMAGE), process.detect(IMAGE)] == ['result', 'result']
    assert len(built) == 1


def test_stamp_of_a_frame_reaches_the_detector(process):
    process.set_reference(IMAGE)
    process.detect(IMAGE, 42)
    assert process._detector.stamps == [42]


def test_new_configuration_is_taken_up_with_the_next_frame(process, built):
    process.set_reference(IMAGE)
    process.config = Config().replaced({'shutter.exposure_rows': 40.0})
    assert len(built) == 1
    process.detect(IMAGE)
    assert built[-1].config.shutter.exposure_rows == 40.0
    assert built[-1].reference is IMAGE


def test_camera_info_is_taken_up_with_the_next_frame(process, built, log):
    process.set_reference(IMAGE)
    process.intrinsics = Intrinsics(500.0, IMAGE.shape[1], distorted=False)
    process.detect(IMAGE)
    process.detect(IMAGE)
    assert [entry.camera for entry in built] == [None, Camera(500.0)]
    assert log == []


def test_depth_belongs_to_the_reference_it_came_with(process, built, monkeypatch):
    compiled = []
    monkeypatch.setattr(processing, 'warm_up', lambda config, depth: compiled.append(depth))
    depth = np.ones(IMAGE.shape, np.float32)
    process.set_reference(IMAGE, depth)
    process.config = Config().replaced({'shutter.exposure_rows': 40.0})
    process.detect(IMAGE)
    process.set_reference(IMAGE)
    process.set_reference(IMAGE, depth)
    assert [entry.depth is depth for entry in built] == [True, True, False, True]
    assert compiled == [True], 'its kernels are compiled once, before a frame waits for them'


def test_guessed_focal_length_is_logged_once(process, log):
    process.set_reference(IMAGE)
    process.detect(IMAGE)
    process.detect(IMAGE)
    (line,) = log
    assert '58 px' in line  # 0.9 x 64
    assert 'camera.focal_px' in line


def test_refused_reference_leaves_none_and_a_good_one_mends_it(process):
    process.set_reference(IMAGE)
    with pytest.raises(FrameError, match='too small'):
        process.set_reference(IMAGE[:8])
    assert process.detect(IMAGE) is None  # never the result of the reference before
    process.set_reference(IMAGE)
    assert process.detect(IMAGE) == 'result'


def test_focal_length_of_another_image_size_is_warned_of_once(process, log):
    process.set_reference(IMAGE)
    process.intrinsics = Intrinsics(500.0, 2 * IMAGE.shape[1], distorted=False)
    process.detect(IMAGE)
    process.detect(IMAGE)
    (line,) = log
    assert '128 px wide, the frames are 64 px wide' in line
