"""The size a file claims is known before it is decoded, whatever stands before it in the file."""

import struct
import time

import cv2
import numpy as np
import pytest

from rsmb_ros.messages.compressed import pixels_claimed
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import check_compressed, image_from_compressed

PICTURE = np.random.default_rng(20170311).integers(0, 256, (37, 53, 3), dtype=np.uint8)


def encoded(suffix, *options):
    return cv2.imencode(suffix, PICTURE, options)[1].tobytes()


def segment(marker, size):
    return bytes([0xFF, marker]) + struct.pack('>H', size + 2) + bytes(size)


@pytest.mark.parametrize(
    'data',
    [
        encoded('.png'),
        encoded('.jpg'),
        encoded('.jpg', cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        # an EXIF block that holds another size, fill bytes, a restart marker
        encoded('.jpg')[:2] + segment(0xE1, 60000) + encoded('.jpg')[2:],
        encoded('.jpg')[:2] + b'\xff' * 9 + encoded('.jpg')[2:],
        encoded('.jpg')[:2] + b'\xff\xd0' + encoded('.jpg')[2:],
    ],
    ids=['png', 'jpeg', 'progressive', 'exif', 'fill', 'restart'],
)
def test_claimed_size_is_that_of_the_picture(data):
    assert pixels_claimed(data, 'x') == PICTURE.shape[:2]


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'\x89PNG\r\n\x1a\n',
        b'\x89PNG\r\n\x1a\n' + bytes(20),
        b'\xff\xd8\xff',
        b'\xff\xd8' + segment(0xE0, 16) + bytes(20),
        encoded('.bmp'),
        encoded('.webp'),
    ],
    ids=['empty', 'png start', 'no IHDR', 'jpeg start', 'no marker', 'bmp', 'webp'],
)
def test_what_has_no_readable_header_is_refused(data):
    with pytest.raises(MalformedMessage, match=r'must be a JPEG or PNG|is cut off'):
        pixels_claimed(data, 'x')


@pytest.mark.parametrize(
    'start',
    [
        b'\xff\xd8' + segment(0xE0, 0) * 500_000,
        b'\xff\xd8' + b'\xff' * 2_000_000,
        b'\xff\xd8' + b'\xff\xd0' * 1_000_000,
        b'\x89PNG\r\n\x1a\n' + bytes(12_000_000),
    ],
)
def test_endless_segments_do_not_hold_up_the_callback(start):
    begin = time.thread_time()
    with pytest.raises(MalformedMessage):
        pixels_claimed(start, 'jpeg')
    assert time.thread_time() - begin < 0.1  # s; walking them all takes several times as long


def test_size_above_the_limit_is_refused_before_decoding(compressed_msg, monkeypatch):
    monkeypatch.setattr(cv2, 'imdecode', lambda *_: pytest.fail('decoded'))
    msg = compressed_msg('png', encoded('.png'))
    for take in (check_compressed, image_from_compressed):
        with pytest.raises(
            MalformedMessage, match=r'37 rows x 53 columns.*max_megapixels = 0\.001'
        ):
            take(msg, 0.001)


def test_size_at_the_limit_is_taken(compressed_msg):
    msg = compressed_msg('png', encoded('.png'))
    np.testing.assert_array_equal(image_from_compressed(msg, 37 * 53 / 1e6), PICTURE)


def test_mosaic_too_small_to_interpolate_is_refused(compressed_msg):
    tiny = cv2.imencode('.png', np.zeros((2, 8), np.uint8))[1].tobytes()
    with pytest.raises(MalformedMessage, match=r'2 rows x 8 columns.*at least 3'):
        image_from_compressed(compressed_msg('bayer_rggb8; png compressed ', tiny))


@pytest.mark.parametrize('length', [200_000, 0x7FFFFFFF, 0x84000000, 0xFFFFFFFF])
def test_chunk_that_claims_more_than_the_file_holds_is_refused_undecoded(
    compressed_msg, monkeypatch, length
):
    """OpenCV would allocate what it claims: found by fuzzing, 4 GB for a file of 176 bytes."""
    data = bytearray(encoded('.png'))
    at = data.index(b'IDAT') - 4
    data[at : at + 4] = struct.pack('>I', length)
    monkeypatch.setattr(cv2, 'imdecode', lambda *_: pytest.fail('decoded'))
    with pytest.raises(MalformedMessage, match=r'PNG .* is cut off') as refused:
        image_from_compressed(compressed_msg('png', bytes(data)))
    assert refused.value.cause == 'short data'


def test_what_follows_the_picture_is_no_harm(compressed_msg):
    for suffix in ('.png', '.jpg'):
        msg = compressed_msg(suffix, encoded(suffix) + bytes(100))
        assert image_from_compressed(msg).shape == PICTURE.shape
