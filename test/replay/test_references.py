"""What the frames are compared with."""

import cv2
import numpy as np
import pytest
from small_flight import START_NS, STEP_NS

from rsmb_ros.bags.opening import open_recording
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.replay.references import choose


def reference_of(path, named, topic=None):
    with open_recording(path) as recording:
        live, reference = choose(recording, named, topic)
        assert not recording.skipped
    return live.name, reference


@pytest.mark.parametrize(
    ('named', 'number'),
    [
        ('@0', 1),
        ('@5', 6),
        ('/image@2', 3),
        ('image@2', 3),
        ('/reference/image@0', 0),
        ('@1700000000.5', 2),
        ('@1700000000.63', 3),  # 0.75 s is nearer than 0.5 s
        ('@1700000000.625', 2),  # as near as 0.75 s: the earlier one
        ('@1700000001.900', 6),
    ],
)
def test_one_frame_is_named_by_index_or_stamp(flight_bag, photos, named, number):
    live, reference = reference_of(flight_bag, named)
    assert live == '/image'
    np.testing.assert_array_equal(reference, photos[number])


def test_frame_of_another_recording(flight_bag, image_folder, photos):
    for named in (f'{flight_bag}@1', f'{flight_bag}:/image@1', f'{flight_bag}:image@1'):
        live, reference = reference_of(image_folder, named)
        assert live == '/image'
        np.testing.assert_array_equal(reference, photos[2])
    _, reference = reference_of(flight_bag, f'{image_folder}@0')
    np.testing.assert_array_equal(reference, photos[1])


def test_image_file_goes_before_a_topic_of_that_name(flight_bag, photos, tmp_path):
    path = tmp_path / 'tile@0.png'
    cv2.imwrite(str(path), photos[4])
    _, reference = reference_of(flight_bag, str(path))
    np.testing.assert_array_equal(reference, photos[4])


@pytest.mark.parametrize(
    ('named', 'error', 'told'),
    [
        ('@6', BagError, r'/image@6: the frames of the topic are 0 to 5'),
        ('/image@99.5', BagError, r'the stamp must be from 1700000000\.25 s on'),
        ('@1700000009.0', BagError, r'not after the last frame, met: 1700000001\.5 s'),
        ('@first', ConfigError, r"'first' after @ must be an index, 0 for the first frame, or"),
        ('@-1', ConfigError, r"'-1' after @ must be an index"),
        ('gone.mcap:/image@0', BagError, r'gone\.mcap: no such file or folder'),
        ('/front@0', BagError, r'topic /front is not in the bag; it has /image \('),
        ('tile.png', BagError, r'--reference tile\.png is neither a file nor a topic'),
    ],
)
def test_what_is_no_reference_says_why(flight_bag, named, error, told):
    with pytest.raises(error, match=told):
        reference_of(flight_bag, named)


def test_recording_without_a_frame_is_no_reference(flight_bag, video_file):
    with pytest.raises(ConfigError, match=r'flight\.avi is a recording: say which frame.*@0'):
        reference_of(flight_bag, str(video_file))


def test_folder_needs_a_reference_and_says_how_to_give_one(image_folder):
    with pytest.raises(BagError, match=r'no reference topic; .* --reference @0, the first frame'):
        reference_of(image_folder, None)


def test_frame_that_cannot_be_read_is_no_reference(tmp_path, factory, photos):
    path = tmp_path / 'some.mcap'
    with BagWriter(path) as bag:
        for n, photo in enumerate(photos[:3]):
            image = factory.image(factory.header(START_NS + n * STEP_NS, ''), photo)
            image.encoding = 'mono8' if n != 1 else 'jpeg2000'
            bag.write('/image', image, START_NS + n * STEP_NS)
    with pytest.raises(BagError, match=r'/image@1: message 1 cannot be read; choose another'):
        reference_of(path, '@1')
