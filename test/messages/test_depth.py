"""Depth images in: REP 118 against literal truth, every contradiction refused."""

import numpy as np
import pytest

from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import depth_from_msg

METRES = np.array([[50, 50, 40], [50, np.nan, 60]], np.float32)
RELATIVE = METRES / 50


@pytest.mark.parametrize(('is_bigendian', 'order'), [(0, '<'), (1, '>')])
@pytest.mark.parametrize('padding', [0, 5])
def test_metres_are_divided_by_their_median(image_msg, is_bigendian, order, padding):
    rows = METRES.astype(f'{order}f4').view(np.uint8)
    stored = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    msg = image_msg('32FC1', 2, 3, stored, is_bigendian=is_bigendian)
    depth = depth_from_msg(msg)
    assert (depth.dtype, depth.shape) == (np.float32, (2, 3))
    np.testing.assert_allclose(depth, RELATIVE, rtol=1e-6)


@pytest.mark.parametrize(('is_bigendian', 'dtype'), [(0, '<u2'), (1, '>u2')])
def test_millimetres_are_too_and_zero_is_unknown(image_msg, is_bigendian, dtype):
    stored = np.nan_to_num(METRES * 1000).astype(dtype)
    depth = depth_from_msg(image_msg('16UC1', 2, 3, stored, is_bigendian=is_bigendian))
    np.testing.assert_allclose(depth, RELATIVE, rtol=1e-6)


def test_relative_depth_stays_what_it_is_where_the_background_is_most_of_it(image_msg):
    depth = depth_from_msg(image_msg('32FC1', 2, 3, RELATIVE))
    np.testing.assert_allclose(depth, RELATIVE, rtol=1e-6)


@pytest.mark.parametrize('nothing', [0.0, -1.0, np.inf, -np.inf, np.nan])
def test_what_is_no_depth_is_unknown(image_msg, nothing):
    stored = np.array([[2.0, nothing], [2.0, 1.0]], np.float32)
    depth = depth_from_msg(image_msg('32FC1', 2, 2, stored))
    np.testing.assert_array_equal(depth, [[1.0, np.nan], [1.0, 0.5]])


def test_depths_too_far_apart_for_a_quotient_are_unknown(image_msg):
    """Found by fuzzing: 1e38 times a subnormal median is no number."""
    stored = np.array([[1e-45, 1e-45], [1e-45, 3e38]], np.float32)
    depth = depth_from_msg(image_msg('32FC1', 2, 2, stored))
    np.testing.assert_array_equal(depth, [[1.0, 1.0], [1.0, np.nan]])
    huge = np.full((2, 2), 3e38, np.float32)  # their sum is no float32
    np.testing.assert_array_equal(depth_from_msg(image_msg('32FC1', 2, 2, huge)), np.ones((2, 2)))


@pytest.mark.parametrize(
    ('encoding', 'shape', 'stored', 'cause'),
    [
        ('mono8', (2, 3), np.ones((2, 3), np.uint8), 'encoding'),
        ('32FC1', (2, 3), np.ones((2, 2), np.float32), 'short step'),
        ('32FC1', (0, 3), b'', 'size'),
        ('16UC1', (2, 3), np.zeros((2, 3), np.uint16), 'no depth'),
    ],
)
def test_contradictions_are_refused_by_cause(image_msg, encoding, shape, stored, cause):
    msg = image_msg(encoding, *shape, stored, step=12 if shape[0] == 0 else None)
    with pytest.raises(MalformedMessage) as refused:
        depth_from_msg(msg)
    assert refused.value.cause == cause
