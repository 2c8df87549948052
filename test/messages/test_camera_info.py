"""CameraInfo in: the focal length of the image it belongs to, nothing from what is useless."""

from types import SimpleNamespace

import pytest

from rsmb_ros.messages.camera_info import Intrinsics, intrinsics_from_msg
from rsmb_ros.messages.errors import MalformedMessage


def info(focal=600.0, width=640, binning=0, roi=0, d=()):
    return SimpleNamespace(
        k=[focal, 0.0, 320.0, 0.0, focal, 240.0, 0.0, 0.0, 1.0],
        d=list(d),
        width=width,
        binning_x=binning,
        roi=SimpleNamespace(width=roi),
    )


def test_focal_length_and_width_are_taken():
    assert intrinsics_from_msg(info()) == Intrinsics(600.0, 640, distorted=False)


@pytest.mark.parametrize(
    ('binning', 'focal', 'width'), [(0, 600, 640), (1, 600, 640), (2, 300, 320)]
)
def test_matrix_is_of_the_unbinned_image(binning, focal, width):
    found = intrinsics_from_msg(info(binning=binning))
    assert (found.focal_px, found.width) == (focal, width)


def test_region_of_interest_is_as_wide_as_the_image():
    assert intrinsics_from_msg(info(roi=200, binning=2)).width == 100


def test_distortion_is_seen_where_there_is_some():
    assert intrinsics_from_msg(info(d=[0.0, 0.0, 1e-3])).distorted
    assert not intrinsics_from_msg(info(d=[0.0] * 5)).distorted


@pytest.mark.parametrize('focal', [0.0, -5.0, float('nan'), float('inf'), 1e6])
def test_useless_focal_length_is_refused_with_its_value(focal):
    with pytest.raises(MalformedMessage, match=r'k\[0\] = .* must be above 0'):
        intrinsics_from_msg(info(focal))
