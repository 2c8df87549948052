"""Callbacks leave references, the worker decodes them: nothing good is lost, nothing is slow."""

import time
from array import array
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.messages.images import image_from_compressed
from rsmb_ros.ros.reception import Reception
from rsmb_ros.ros.references import References

P99_S = 5e-3  # of a callback, at 1080p
ROUNDS = 100


class Told:
    """Stands for health, log and worker: remembers what it was told."""

    def __init__(self):
        self.malformed_causes, self.said, self.submitted = [], [], []
        self.received = 0

    def reference_received(self):
        self.received += 1

    def frame_received(self):
        pass

    def malformed(self, cause):
        self.malformed_causes.append(cause)

    def info(self, text, **options):
        self.said.append(text)

    warning = info

    def submit_reference(self, references):
        self.submitted.append(references)

    def submit_frame(self, frame):
        pass

    def refuse(self, cause):
        pass


@pytest.fixture
def told():
    return Told()


def compressed(data, form='png'):
    return SimpleNamespace(header=header(), format=form, data=array('B', data))


def header(stamp_ns=0):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id='')


def picture(value=0, shape=(32, 40)):
    rng = np.random.default_rng(value)
    return rng.integers(0, 256, shape, dtype=np.uint8)


def png(image):
    return cv2.imencode('.png', image)[1].tobytes()


def broken(data):
    """Return a PNG whose pixels are garbage: only its decoder can tell."""
    start = data.index(b'IDAT') + 4
    return data[:start] + bytes(len(data) - start - 16) + data[-16:]


@pytest.fixture
def decoded(told):
    """Return references and the list of what was decoded for them."""
    calls = []

    def convert(msg, limit):
        calls.append(msg)
        return image_from_compressed(msg, limit)

    return References(convert, ('format', 'data'), told, told), calls


def test_repeated_file_is_not_decoded_again_and_changes_nothing(decoded, told):
    references, calls = decoded
    for stamp in (1, 2, 3):
        references.leave_image(compressed(png(picture())), stamp, 50.0)
        pair = references.take()
        assert (pair is not None) == (stamp == 1)
    assert (len(calls), told.received) == (1, 1)
    references.leave_image(compressed(png(picture(1))), 4, 50.0)
    np.testing.assert_array_equal(references.take().image, picture(1))
    assert (len(calls), told.received) == (2, 2)


def test_newest_of_those_that_wait_is_taken(decoded):
    references, calls = decoded
    for value in range(3):
        references.leave_image(compressed(png(picture(value))), value, 50.0)
    np.testing.assert_array_equal(references.take().image, picture(2))
    assert len(calls) == 1
    assert references.take() is None


def test_broken_file_does_not_push_out_the_good_one_before_it(decoded, told):
    references, _ = decoded
    references.leave_image(compressed(png(picture())), 1, 50.0)
    references.leave_image(compressed(broken(png(picture(1)))), 2, 50.0)
    np.testing.assert_array_equal(references.take().image, picture())
    assert told.malformed_causes == ['undecodable']


def test_depth_and_image_that_come_together_are_one_pair(decoded):
    references, _ = decoded
    depth = np.full((32, 40), 7.0, np.float32)
    depth[:4] = 3.5
    references.leave_depth(raw(depth, '32FC1'), 9, 50.0)
    references.leave_image(compressed(png(picture())), 9, 50.0)
    pair = references.take()
    np.testing.assert_array_equal(pair.image, picture())
    np.testing.assert_array_equal(pair.depth, depth / 7)


def raw(image, encoding):
    height, width = image.shape[:2]
    data = array('B', image.tobytes())
    return SimpleNamespace(
        header=header(),
        encoding=encoding,
        height=height,
        width=width,
        step=len(data) // height,
        is_bigendian=0,
        data=data,
    )


SHAPE = (1080, 1920)


@pytest.mark.parametrize(
    ('kind', 'topic'),
    [
        (kind, topic)
        for kind in ('raw', 'jpeg', 'png')
        for topic in ('image', 'reference', 'reference repeated')
    ]
    + [('raw', 'depth')],
)
def test_callback_at_1080p_takes_below_5_ms(told, kind, topic):
    scene = cv2.GaussianBlur(picture(shape=(*SHAPE, 3)), (0, 0), 2)
    if topic == 'depth':
        msg = raw(np.full(SHAPE, 3.0, np.float32), '32FC1')
    elif kind == 'raw':
        msg = raw(scene, 'bgr8')
    else:
        msg = compressed(cv2.imencode(f'.{kind}', scene)[1].tobytes(), kind)
    reception = Reception(
        compressed=kind != 'raw',
        worker=told,
        health=told,
        on_intrinsics=None,
        max_megapixels=lambda: 50.0,
        now_ns=lambda: 0,
        log=told,
    )
    if topic == 'reference repeated':
        reception.reference(msg)
        assert told.submitted[0].take() is not None
    callback = getattr(reception, topic.split()[0])
    took = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        callback(msg)
        took.append(time.thread_time() - begin)
    assert not told.malformed_causes
    assert sorted(took)[int(0.99 * ROUNDS) - 1] < P99_S
