"""A conversion returns an image or says why not, whatever a message says; memory is bounded."""

import math
import resource
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('hypothesis', reason='pip install rsmb_ros[test]')

from fuzzing import camera_infos, compressed, images, thorough
from hypothesis import given
from hypothesis import strategies as st

from rsmb_ros.core.depth_map import checked_depth
from rsmb_ros.core.errors import FrameError
from rsmb_ros.messages.camera_info import intrinsics_from_msg
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import (
    check_compressed,
    check_image,
    depth_from_msg,
    image_from_compressed,
    image_from_msg,
)
from rsmb_ros.messages.stamps import stamp_ns

LIMIT_MPX = 4.0
EXAMPLES = 400
ROOM_MB = 80  # for one message: an image at the limit, 16 bit with alpha, and its conversion


def taken(convert, msg):
    """Return what `convert` makes of a message, None where it says what is wrong."""
    before = peak_mb()
    try:
        return convert(msg, LIMIT_MPX)
    except MalformedMessage as error:
        assert error.cause
        assert str(error)
        return None
    finally:
        assert peak_mb() - before < ROOM_MB


def peak_mb():
    """Return the largest memory this process ever had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def check_pixels(image, check, msg):
    assert image.dtype == np.uint8
    assert image.ndim == 2 or image.shape[2:] == (3,)
    assert 0 < image.shape[0] * image.shape[1] <= LIMIT_MPX * 1e6
    assert image.flags.c_contiguous
    assert image.flags.writeable
    check(msg, LIMIT_MPX)  # has nothing against it either


@given(images())
@thorough(EXAMPLES)
def test_image_is_taken_or_refused_with_a_reason(fields):
    msg = SimpleNamespace(**fields)
    image = taken(image_from_msg, msg)
    if image is not None:
        check_pixels(image, check_image, msg)
        assert image.shape[:2] == (msg.height, msg.width)


@given(compressed())
@thorough(EXAMPLES)
def test_compressed_image_is_taken_or_refused_with_a_reason(fields):
    msg = SimpleNamespace(**fields)
    image = taken(image_from_compressed, msg)
    if image is not None:
        check_pixels(image, check_compressed, msg)


@given(images(st.sampled_from(['32FC1', '16UC1', 'mono8'])))
@thorough(EXAMPLES)
def test_depth_is_taken_or_refused_with_a_reason(fields):
    msg = SimpleNamespace(**fields)
    depth = taken(depth_from_msg, msg)
    if depth is not None:
        assert depth.shape == (msg.height, msg.width)
        known = depth[~np.isnan(depth)]
        assert known.size
        assert (known > 0).all()
        try:
            checked_depth(depth, depth.shape)
        except FrameError as error:
            assert str(error)


@given(camera_infos())
@thorough(EXAMPLES)
def test_camera_info_is_taken_or_refused_with_a_reason(fields):
    msg = SimpleNamespace(**fields, roi=SimpleNamespace(width=fields['roi_width']))
    try:
        found = intrinsics_from_msg(msg)
    except MalformedMessage as error:
        assert 'focal length' in str(error)
        return
    assert math.isfinite(found.focal_px)
    assert 0 < found.focal_px <= 1e5
    assert found.width >= 0


@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
@thorough(EXAMPLES)
def test_stamp_is_exact_or_refused(sec, nanosec):
    stamp = SimpleNamespace(sec=sec, nanosec=nanosec)
    try:
        found = stamp_ns(stamp)
    except MalformedMessage:
        assert sec < 0 or nanosec >= 10**9
        return
    assert divmod(found, 10**9) == (sec, nanosec)
