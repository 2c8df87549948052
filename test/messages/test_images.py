"""Image messages in: every encoding against literal truth, every contradiction refused."""

import array
import tracemalloc
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.core.errors import FrameError
from rsmb_ros.messages.images import KNOWN_ENCODINGS, image_from_compressed, image_from_msg

B, G, R = 10, 120, 240
# Two rows of two pixels, as each mosaic has them from the top left.
MOSAICS = {
    'bayer_rggb': [[R, G], [G, B]],
    'bayer_bggr': [[B, G], [G, R]],
    'bayer_gbrg': [[G, B], [R, G]],
    'bayer_grbg': [[G, R], [B, G]],
}


@pytest.fixture
def grey():
    return np.random.default_rng(20170301).integers(0, 256, (6, 8), dtype=np.uint8)


@pytest.fixture
def colour():
    return np.random.default_rng(20170302).integers(0, 256, (6, 8, 3), dtype=np.uint8)


@pytest.mark.parametrize('encoding', ['mono8', '8UC1'])
def test_grey_passes_unchanged_and_without_a_copy(image_msg, grey, encoding):
    msg = image_msg(encoding, 6, 8, grey)
    image = image_from_msg(msg)
    np.testing.assert_array_equal(image, grey)
    assert np.shares_memory(image, msg.data)


@pytest.mark.parametrize('encoding', ['bgr8', '8UC3'])
def test_bgr_passes_unchanged(image_msg, colour, encoding):
    np.testing.assert_array_equal(image_from_msg(image_msg(encoding, 6, 8, colour)), colour)


def test_rgb_is_reversed(image_msg, colour):
    np.testing.assert_array_equal(
        image_from_msg(image_msg('rgb8', 6, 8, colour)), colour[..., ::-1]
    )


@pytest.mark.parametrize(('encoding', 'order'), [('bgra8', [0, 1, 2]), ('rgba8', [2, 1, 0])])
def test_alpha_is_left_out(image_msg, encoding, order):
    stored = np.random.default_rng(3).integers(0, 256, (6, 8, 4), dtype=np.uint8)
    np.testing.assert_array_equal(
        image_from_msg(image_msg(encoding, 6, 8, stored)), stored[..., order]
    )


@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
@pytest.mark.parametrize(('is_bigendian', 'dtype'), [(0, '<u2'), (1, '>u2')])
def test_16_bit_becomes_8_bit_by_full_scale(image_msg, encoding, is_bigendian, dtype):
    stored = np.array([[0, 128, 129, 257], [32768, 65406, 65407, 65535]], dtype)
    image = image_from_msg(image_msg(encoding, 2, 4, stored, is_bigendian=is_bigendian))
    # value * 255 / 65535, rounded
    np.testing.assert_array_equal(image, [[0, 0, 1, 1], [128, 254, 255, 255]])


@pytest.mark.parametrize('name', MOSAICS)
@pytest.mark.parametrize(('bits', 'dtype', 'scale'), [(8, np.uint8, 1), (16, '<u2', 257)])
def test_mosaic_of_one_colour_becomes_that_colour(image_msg, name, bits, dtype, scale):
    stored = (np.tile(MOSAICS[name], (4, 4)) * scale).astype(dtype)
    image = image_from_msg(image_msg(f'{name}{bits}', 8, 8, stored))
    np.testing.assert_array_equal(image, np.broadcast_to([B, G, R], (8, 8, 3)))


@pytest.mark.parametrize(
    ('encoding', 'order'), [('yuv422_yuy2', [0, 1, 2, 3]), ('yuv422', [1, 0, 3, 2])]
)
def test_yuv422_becomes_the_colours_of_bt601(image_msg, encoding, order):
    y0_u_y1_v = np.array([81, 90, 235, 240], np.uint8)  # red, and the brightest with its chroma
    stored = np.tile(y0_u_y1_v[order], (2, 2))
    image = image_from_msg(image_msg(encoding, 2, 4, stored))
    assert image.shape == (2, 4, 3)
    # Red in studio range; the converters of OpenCV differ by 1 between versions.
    np.testing.assert_allclose(image[0, 0].astype(int), [0, 0, 255], atol=2)
    np.testing.assert_array_equal(image[:, 0], image[:, 2])


def test_nv12_takes_luma_and_chroma_from_their_planes(image_msg):
    luma = np.full((4, 6), 81, np.uint8)
    chroma = np.tile(np.array([90, 240], np.uint8), (2, 3))  # U, V in turn
    image = image_from_msg(image_msg('nv12', 4, 6, np.vstack([luma, chroma]), step=6))
    expected = np.broadcast_to([0, 0, 255], (4, 6, 3))
    np.testing.assert_allclose(image.astype(int), expected, atol=2)


@pytest.mark.parametrize('padding', [1, 5])
def test_row_padding_is_left_out(image_msg, colour, padding):
    stored = np.full((6, 8 * 3 + padding), 77, np.uint8)
    stored[:, : 8 * 3] = colour.reshape(6, -1)
    np.testing.assert_array_equal(image_from_msg(image_msg('bgr8', 6, 8, stored)), colour)


def test_row_padding_of_an_odd_number_of_bytes_is_left_out_of_16_bit(image_msg):
    values = np.array([[0, 257], [514, 771]], '>u2')
    stored = np.zeros((2, 7), np.uint8)
    stored[:, :4] = values.view(np.uint8)
    image = image_from_msg(image_msg('mono16', 2, 2, stored, is_bigendian=1))
    np.testing.assert_array_equal(image, [[0, 1], [2, 3]])


def test_row_padding_of_nv12_is_left_out_of_both_planes(image_msg):
    stored = np.full((3, 6), 255, np.uint8)
    stored[:2, :4] = 81
    stored[2, :4] = [90, 240, 90, 240]
    image = image_from_msg(image_msg('nv12', 2, 4, stored, step=6))
    np.testing.assert_allclose(image.astype(int), np.broadcast_to([0, 0, 255], (2, 4, 3)), atol=2)


@pytest.mark.parametrize('encoding', KNOWN_ENCODINGS)
def test_every_encoding_gives_a_writable_contiguous_uint8_image(image_msg, encoding):
    stored = np.zeros((8, 8 * 8), np.uint8)
    stored.flags.writeable = False  # as the bytes of a bag are
    image = image_from_msg(image_msg(encoding, 4, 4, stored, step=64 // 2))
    assert image.dtype == np.uint8
    assert image.shape in {(4, 4), (4, 4, 3)}
    assert image.flags.c_contiguous
    assert image.flags.writeable


def test_image_outlives_its_message(image_msg):
    msg = SimpleNamespace(
        **{**vars(image_msg('mono8', 2, 2, bytes(4))), 'data': array.array('B', [1, 2, 3, 4])}
    )
    image = image_from_msg(msg)
    del msg
    np.testing.assert_array_equal(image, [[1, 2], [3, 4]])


MALFORMED = {
    'short data': ('mono8', 4, 4, 15, 4, '4 rows x 4 columns.*15 bytes.*16'),
    'no data': ('mono8', 4, 4, 0, 4, '0 bytes'),
    'short chroma': ('nv12', 4, 4, 23, 4, '23 bytes.*24'),
    'no rows': ('mono8', 0, 4, 16, 4, '0 rows x 4'),
    'no columns': ('mono8', 4, 0, 16, 4, '4 rows x 0'),
    'step of one channel': ('bgr8', 4, 4, 48, 4, 'step is 4 bytes.*12'),
    'no step': ('mono8', 4, 4, 16, 0, 'step is 0 bytes.*4'),
    'odd width': ('yuv422_yuy2', 4, 3, 24, 6, '4 rows x 3.*even'),
    'odd height': ('nv12', 3, 4, 24, 4, '3 rows x 4.*even'),
    'encoding': ('mono9', 4, 4, 16, 4, "'mono9', known: mono8, .*nv12"),
    'no encoding': ('', 4, 4, 16, 4, 'known: mono8'),
}


@pytest.mark.parametrize(
    ('encoding', 'height', 'width', 'size', 'step', 'says'), MALFORMED.values(), ids=MALFORMED
)
def test_contradiction_is_refused_with_its_numbers(
    image_msg, encoding, height, width, size, step, says
):
    with pytest.raises(FrameError, match=says):
        image_from_msg(image_msg(encoding, height, width, bytes(size), step))


def test_lying_header_allocates_nothing(image_msg):
    msg = image_msg('bgr8', 65535, 65535, bytes(100), step=3 * 65535)
    tracemalloc.start()
    try:
        with pytest.raises(FrameError, match='100 bytes'):
            image_from_msg(msg)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000  # bytes; the header claims 13 GB


@pytest.mark.parametrize('bits', [8, 16])
@pytest.mark.parametrize(('height', 'width'), [(1, 1), (2, 8), (8, 2)])
def test_mosaic_too_small_to_interpolate_is_refused_not_blackened(image_msg, bits, height, width):
    msg = image_msg(f'bayer_rggb{bits}', height, width, bytes(height * width * 2), step=2 * width)
    with pytest.raises(FrameError, match=f'{height} rows x {width} columns.*at least 3'):
        image_from_msg(msg)


def encoded(suffix, pixels):
    return cv2.imencode(suffix, pixels)[1].tobytes()


@pytest.mark.parametrize('text', ['png', 'bgr8; png compressed bgr8', ''])
def test_png_is_decoded_exactly(compressed_msg, colour, text):
    image = image_from_compressed(compressed_msg(text, encoded('.png', colour)))
    np.testing.assert_array_equal(image, colour)


@pytest.mark.parametrize('text', ['jpeg', 'jpg', 'bgr8; jpeg compressed bgr8'])
def test_jpeg_is_decoded(compressed_msg, text):
    smooth = np.broadcast_to(np.arange(0, 240, 10, dtype=np.uint8)[:, None, None], (24, 16, 3))
    image = image_from_compressed(compressed_msg(text, encoded('.jpg', smooth)))
    np.testing.assert_allclose(image.astype(int), smooth, atol=4)  # quality 95


def test_grey_stays_grey_when_decoded(compressed_msg, grey):
    image = image_from_compressed(compressed_msg('mono8; png compressed ', encoded('.png', grey)))
    np.testing.assert_array_equal(image, grey)


def test_16_bit_png_becomes_8_bit_by_full_scale(compressed_msg):
    stored = np.array([[0, 257], [65278, 65535]], np.uint16)
    image = image_from_compressed(compressed_msg('16UC1; png compressed', encoded('.png', stored)))
    np.testing.assert_array_equal(image, [[0, 1], [254, 255]])


def test_mosaic_in_a_png_is_coloured(compressed_msg):
    stored = np.tile(np.array(MOSAICS['bayer_rggb'], np.uint8), (4, 4))
    msg = compressed_msg('bayer_rggb8; png compressed ', encoded('.png', stored))
    np.testing.assert_array_equal(image_from_compressed(msg), np.broadcast_to([B, G, R], (8, 8, 3)))


@pytest.mark.parametrize(
    ('data', 'says'),
    [
        (b'', 'no data'),
        (b'\x00' * 50, '50 bytes.*cannot be decoded'),
        (b'\xff\xd8 not a jpeg \xff\xd9', 'cannot be decoded'),
    ],
)
def test_rubbish_is_refused(compressed_msg, data, says):
    with pytest.raises(FrameError, match=says):
        image_from_compressed(compressed_msg('jpeg', data))


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_cut_off_file_is_refused_not_filled_with_grey(compressed_msg, colour, suffix):
    data = encoded(suffix, cv2.resize(colour, (64, 64)))
    with pytest.raises(FrameError, match='cut off'):
        image_from_compressed(compressed_msg(suffix, data[: len(data) * 2 // 3]))
