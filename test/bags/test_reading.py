"""Every format gives the same frames; every bad input says what is wrong and what to do."""

import numpy as np
import pytest

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import BagError

FORMATS = ('folder sqlite3', 'folder mcap', 'file db3', 'file mcap', 'our mcap', 'ros 1')


@pytest.mark.parametrize('kind', FORMATS)
def test_frames_are_equal_in_every_format(write_images, pictures, kind):
    with Bag(write_images(kind, pictures)) as bag:
        frames = list(bag.frames('/image'))
        assert [(topic.name, topic.count) for topic in bag.topics] == [('/image', 3)]
    assert [frame.stamp_ns for frame in frames] == [0, 100_000_000, 200_000_000]
    assert [frame.log_time_ns for frame in frames] == [0, 100_000_000, 200_000_000]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert {frame.frame_id for frame in frames} == {'cam'}
    for frame, picture in zip(frames, pictures, strict=True):
        np.testing.assert_array_equal(frame.image, picture)


@pytest.mark.parametrize('kind', ['our mcap', 'ros 1'])
def test_header_of_any_format_can_be_written_on(write_images, pictures, factory, tmp_path, kind):
    out = tmp_path / 'out.mcap'
    with Bag(write_images(kind, pictures)) as bag, BagWriter(out) as writer:
        for frame in bag.frames('/image'):
            writer.write('/copy', factory.image(frame.header, frame.image), frame.stamp_ns)
    with Bag(out) as bag:
        copies = list(bag.frames('/copy'))
    assert [copy.stamp_ns for copy in copies] == [0, 100_000_000, 200_000_000]
    np.testing.assert_array_equal(copies[2].image, pictures[2])


def test_serialised_messages_are_those_of_the_bag(write_topics, factory):
    path = write_topics({'/a': factory.text('hello'), '/b': factory.text('other')})
    with Bag(path) as bag:
        ((topic, time_ns, data),) = bag.cdr('/a')
    assert (topic, time_ns) == ('/a', 0)
    assert data.endswith(b'hello\x00')


def test_serialised_messages_of_ros_1_are_refused(write_images, pictures):
    with (
        Bag(write_images('ros 1', pictures)) as bag,
        pytest.raises(BagError, match=r'images\.bag: a ROS 1 bag; convert it first'),
    ):
        next(bag.cdr('/image'))


def broken(factory, picture, **changes):
    image = factory.image(factory.header(0, ''), picture)
    for name, value in changes.items():
        setattr(image, name, value)
    return image


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'data': np.zeros(5, np.uint8)}, 'data has 5 bytes, must have 768'),
        ({'encoding': 'jpeg2000'}, "encoding is 'jpeg2000'"),
        ({'height': 0}, '0 rows'),
    ],
)
def test_frame_that_cannot_be_read_is_counted_and_skipped(
    tmp_path, factory, pictures, caplog, changes, reason
):
    path = tmp_path / 'some.mcap'
    with BagWriter(path) as writer:
        writer.write('/image', broken(factory, pictures[0]), 0)
        writer.write('/image', broken(factory, pictures[1], **changes), 1)
        writer.write_cdr('/image', 'sensor_msgs/msg/Image', b'\x00\x01\x00\x00\x07', 2)
        writer.write('/image', broken(factory, pictures[2]), 3)
    with Bag(path) as bag:
        frames = list(bag.frames('/image'))
        assert bag.skipped == {'/image': 2}
    assert [frame.index for frame in frames] == [0, 3]
    np.testing.assert_array_equal(frames[1].image, pictures[2])
    first, second = (record.getMessage() for record in caplog.records)
    assert 'message 1 of /image skipped' in first
    assert reason in first
    assert 'message 2 of /image skipped: no sensor_msgs/msg/Image' in second


def test_damaged_message_of_another_type_names_bag_and_topic(tmp_path):
    path = tmp_path / 'text.mcap'
    with BagWriter(path) as writer:
        writer.write_cdr('/text', 'std_msgs/msg/String', b'\x00\x01\x00\x00\xff\x00\x00\x00', 0)
    with Bag(path) as bag, pytest.raises(BagError, match=r'text\.mcap: a message of /text is'):
        next(bag.messages('/text'))


@pytest.mark.parametrize('kind', ['folder sqlite3', 'folder mcap'])
def test_quality_of_service_told_in_two_ways_loses_no_message(write_images, pictures, kind):
    folder = write_images(kind, pictures)
    path = folder / 'metadata.yaml'
    text = path.read_text()
    told = 'offered_qos_profiles: []'
    assert told in text
    profile = {
        'history': 3,
        'depth': 0,
        'reliability': 1,
        'durability': 2,
        'liveliness': 1,
        **{name: {'sec': 0, 'nsec': 0} for name in ('deadline', 'lifespan')},
        'liveliness_lease_duration': {'sec': 0, 'nsec': 0},
        'avoid_ros_namespace_conventions': False,
    }
    path.write_text(text.replace(told, f'offered_qos_profiles: {[profile]}'))
    with Bag(folder) as bag:
        assert len(list(bag.frames('/image'))) == len(pictures)


# -- which topic is which ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ('names', 'reference', 'live'),
    [
        (['/reference/image', '/image'], '/reference/image', '/image'),
        (['/map/reference/image', '/cam/image'], '/map/reference/image', '/cam/image'),
        (
            ['/reference/image', '/image', '/rsmb/overlay', '/truth/image'],
            '/reference/image',
            '/image',
        ),
        (['/reference/image', '/cam/image_raw'], '/reference/image', '/cam/image_raw'),
    ],
)
def test_topics_are_told_by_their_names(write_topics, blank, names, reference, live):
    with Bag(write_topics(dict.fromkeys(names, blank))) as bag:
        assert bag.guess_reference().name == reference
        assert bag.guess_live(reference).name == live


def test_compressed_topics_are_told_by_their_names(write_topics, factory):
    image = factory.compressed(factory.header(0, ''), b'', 'jpeg')
    names = ('/reference/image/compressed', '/image/compressed')
    with Bag(write_topics(dict.fromkeys(names, image))) as bag:
        assert bag.guess_reference().name == names[0]
        assert bag.guess_live(names[0]).name == names[1]


def test_several_candidates_are_listed(write_topics, blank):
    with Bag(write_topics(dict.fromkeys(('/left/image', '/right/image'), blank))) as bag:
        with pytest.raises(BagError, match=r'several live image topics \(/left/image, /right/im'):
            bag.guess_live(None)
        with pytest.raises(BagError, match=r'no reference topic; give one with --reference') as no:
            bag.guess_reference()
    assert '/left/image (sensor_msgs/msg/Image, 1 messages)' in str(no.value)


def test_absent_topic_lists_those_that_are_there(write_topics, blank, factory):
    path = write_topics({'/image': blank, '/text': factory.text('')})
    with Bag(path) as bag, pytest.raises(BagError) as absent:
        bag.topic('/imgae')
    assert str(absent.value) == (
        f'{path}: topic /imgae is not in the bag; it has /image (sensor_msgs/msg/Image, '
        '1 messages), /text (std_msgs/msg/String, 1 messages)'
    )


def test_topic_without_images_is_refused(write_topics, factory):
    with (
        Bag(write_topics({'/text': factory.text('')})) as bag,
        pytest.raises(BagError, match=r'topic /text holds std_msgs/msg/String, must be sensor'),
    ):
        bag.image_topic('text')


def test_focal_length_comes_from_the_only_camera_info(write_topics, factory):
    info = factory.camera_info(factory.header(0, ''), (48, 64), 50.0)
    with Bag(write_topics({'/camera_info': info})) as bag:
        assert bag.focal_px() == 50.0
    with Bag(write_topics({'/a/camera_info': info, '/b/camera_info': info})) as bag:
        assert bag.focal_px() is None


def test_focal_length_is_that_of_the_binned_image(write_topics, factory):
    info = factory.camera_info(factory.header(0, ''), (48, 64), 50.0)
    info.binning_x = info.binning_y = 2
    with Bag(write_topics({'/camera_info': info})) as bag:
        assert bag.focal_px() == 25.0


def test_impossible_focal_length_is_none(write_topics, factory):
    info = factory.camera_info(factory.header(0, ''), (48, 64), 0.0)
    with Bag(write_topics({'/camera_info': info})) as bag:
        assert bag.focal_px() is None


# -- what is no bag ----------------------------------------------------------------------------


def test_missing_file_is_named(tmp_path):
    with pytest.raises(BagError, match=r'gone\.mcap: no such file or folder; a bag is a rosbag2'):
        Bag(tmp_path / 'gone.mcap')


@pytest.mark.parametrize('name', ['notes.txt', 'notes.mcap', 'notes.db3', 'notes.bag'])
def test_other_files_are_no_bags(tmp_path, name):
    path = tmp_path / name
    path.write_text('these are notes\n' * 20)
    with pytest.raises(BagError, match=rf'{name}: cannot be read as a bag: .*must be a rosbag2'):
        Bag(path)


def test_empty_folder_is_no_bag(tmp_path):
    with pytest.raises(BagError, match=r'neither metadata\.yaml, \.mcap nor \.db3'):
        Bag(tmp_path)


def test_bag_without_messages_is_refused(tmp_path):
    path = tmp_path / 'empty.mcap'
    with BagWriter(path):
        pass
    with pytest.raises(BagError, match=r'empty\.mcap: the bag has no messages'):
        Bag(path)


@pytest.mark.parametrize('kind', ['file mcap', 'file db3', 'ros 1'])
def test_damaged_bag_is_a_bag_error_wherever_it_is_hit(write_images, pictures, kind):
    path = write_images(kind, pictures)
    whole = path.read_bytes()
    rng = np.random.default_rng(20170306)
    refused = 0
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 8):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged[: rng.integers(len(whole) // 2, len(whole) + 1)])
        try:
            with Bag(path) as bag:
                for frame in bag.frames('/image'):
                    assert frame.image.dtype == np.uint8
        except BagError:
            refused += 1
    assert refused > 0
