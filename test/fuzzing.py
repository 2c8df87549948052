"""
Messages that nobody should send, for hypothesis: fields as plain values, no ROS needed.

``RSMB_FUZZ=100000 pytest test/messages/test_fuzz.py`` runs so many examples of each test.
"""

import os
import zlib

import cv2
import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from rsmb_ros.messages.images import KNOWN_ENCODINGS


def thorough(examples):
    """Return settings for so many examples, or as many as RSMB_FUZZ says; no luck involved."""
    return settings(
        max_examples=int(os.environ.get('RSMB_FUZZ', examples)),
        deadline=None,  # other processes may be busy
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


SIZES = st.one_of(
    st.integers(0, 40), st.sampled_from([255, 256, 4096, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1])
)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
ENCODINGS = st.one_of(
    st.sampled_from([*KNOWN_ENCODINGS, '32FC1', '64FC1', 'BGR8', 'nv21', '']), st.text(max_size=12)
)
FORMATS = st.one_of(
    st.sampled_from(
        [
            *['', 'jpeg', 'jpg', 'png', 'bgr8; jpeg compressed bgr8', '16UC1; png compressed '],
            *['bayer_rggb8; png compressed ', 'bayer_grbg16; png compressed ', 'bayer_;', ';;;'],
        ]
    ),
    st.text(max_size=20),
)
FLOATS = st.floats(allow_nan=True, allow_infinity=True, width=64)


@st.composite
def images(draw, encodings=ENCODINGS):
    """Return the fields of an Image, most of them nearly right."""
    encoding = draw(encodings)
    height, width = draw(SIZES), draw(SIZES)
    row = width * draw(st.sampled_from([1, 2, 3, 4, 8]))
    step = draw(st.one_of(st.just(row), st.integers(row, row + 9), SIZES))
    exact = height * step * draw(st.sampled_from([2, 3])) // 2
    size = draw(st.one_of(st.just(exact), st.integers(exact - 3, exact + 3), st.integers(0, 64)))
    # what does not fit into a test is short data then
    size = min(max(size, 0), 1 << 16)
    seed = draw(st.binary(min_size=1, max_size=16))
    return {
        'encoding': encoding,
        'height': height,
        'width': width,
        'step': min(step, 2**32 - 1),
        'is_bigendian': draw(st.integers(0, 255)),
        'data': (seed * (size // len(seed) + 1))[:size],
        'stamp': draw(STAMPS),
    }


def _files():
    rng = np.random.default_rng(20170312)
    grey = rng.integers(0, 256, (9, 11), dtype=np.uint8)
    pictures = [grey, np.dstack([grey] * 3), np.dstack([grey] * 4), grey.astype(np.uint16) * 257]
    files = [cv2.imencode('.png', picture)[1].tobytes() for picture in pictures]
    files += [cv2.imencode('.jpg', picture)[1].tobytes() for picture in pictures[:2]]
    progressive = [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]
    files.append(cv2.imencode('.jpg', pictures[1], progressive)[1].tobytes())
    return [*files, cv2.imencode('.bmp', grey)[1].tobytes(), zlib.compress(files[0]), b'']


FILES = _files()


@st.composite
def files(draw):
    """Return the bytes of a picture, changed here and there, cut off or continued."""
    data = bytearray(draw(st.sampled_from(FILES)))
    if data:
        for _ in range(draw(st.integers(0, 6))):
            at = draw(st.integers(0, len(data) - 1))
            data[at] = draw(st.integers(0, 255))
        if draw(st.booleans()):
            at = draw(st.integers(0, len(data)))
            data[at:at] = draw(st.binary(max_size=30))
        if draw(st.integers(0, 3)) == 0:
            del data[draw(st.integers(0, len(data))) :]
    return bytes(data)


@st.composite
def compressed(draw):
    """Return the fields of a CompressedImage."""
    return {'format': draw(FORMATS), 'data': draw(files()), 'stamp': draw(STAMPS)}


@st.composite
def camera_infos(draw):
    """Return the fields of a CameraInfo."""
    return {
        'k': draw(st.lists(FLOATS, min_size=9, max_size=9)),
        'd': draw(st.lists(FLOATS, max_size=14)),
        'width': draw(SIZES),
        'height': draw(SIZES),
        'binning_x': draw(SIZES),
        'roi_width': draw(SIZES),
        'stamp': draw(STAMPS),
    }
