"""The stream is that of `rsmb synth`; its errors are in pixels."""

import math

import cv2
import numpy as np
import pytest

from rsmb_ros.cli.main import main
from rsmb_ros.core import Config
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.synthesis import SyntheticFlight
from rsmb_ros.evaluation.speed.stream import row_error, stream_frames, stream_plan

SMALL = (240, 320)
GRID = Grid(SMALL, SMALL, 288.0)


@pytest.fixture
def poses():
    """Return a pose a row, offset by some pixels."""
    found = np.tile([3.0, -2.0, 0.2, 1.01, 0.05, -0.05], (SMALL[0], 1))
    found[:, 0] += np.linspace(0, 4, SMALL[0])
    return found


def test_stream_is_the_flight_of_synth(tmp_path):
    assert main(['synth', '-o', str(tmp_path), '--frames', '2', '--size', '320x240']) == 0
    flight = SyntheticFlight(stream_plan(2), SMALL)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / 'reference.png')), flight.reference)
    for frame in flight.frames():
        written = cv2.imread(str(tmp_path / f'live_{frame.index:03d}.png'))
        np.testing.assert_array_equal(written, frame.live)


def test_every_frame_is_registered_and_every_tenth_alone_too():
    found = list(stream_frames(11, Config().replaced({'layers.enabled': False}), SMALL))
    assert [one.index for one in found] == list(range(11))
    alone = [n % 10 == 0 for n in range(11)]
    assert [one.alone is not None for one in found] == alone
    assert [not math.isnan(one.row_error_alone) for one in found] == alone
    assert all(one.stream.registered for one in found)
    # px; houses fill much of so small a frame and bend its path, the flight is 10 times as far off
    assert all(one.row_error < 2.0 for one in found)


def test_rows_in_the_right_place_have_no_error(poses):
    assert row_error(poses, poses, GRID) == 0.0


def test_error_of_the_rows_is_in_pixels(poses):
    moved = poses.copy()
    moved[:, :2] += (3.0, 4.0)
    assert row_error(moved, poses, GRID) == pytest.approx(5.0, rel=0.02)  # tilt and zoom


def test_what_undoes_itself_is_no_error(poses):
    """A little tilt moves a frame of a long lens as an offset does."""
    far = Grid(SMALL, SMALL, 1e5)
    tilted = poses.copy()
    tilted[:, 5] += 0.001  # deg, 1.7 px at this focal length
    tilted[:, 0] -= far.focal_px * math.radians(0.001)
    assert row_error(tilted, poses, far) < 0.05
