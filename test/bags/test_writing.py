"""What is written can be read by others, whole, whatever happens in between."""

import json

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability

import rsmb_ros
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import BagError
from rsmb_ros.messages.detections import DetectionFields
from rsmb_ros.messages.diagnostics import StatusFields
from rsmb_ros.messages.outputs import OUTPUTS

STAMP_NS = 12_000_000_034


def read_back(path):
    """Return (topic, log time, message) of everything in a bag."""
    with AnyReader([path]) as reader:
        return [
            (connection.topic, time_ns, reader.deserialize(data, connection.msgtype))
            for connection, time_ns, data in reader.messages()
        ]


@pytest.fixture
def written(tmp_path):
    """Write one message, return it as it was read back."""

    def write(message):
        path = tmp_path / 'one.mcap'
        with BagWriter(path) as writer:
            writer.write('/topic', message, STAMP_NS)
        ((topic, time_ns, found),) = read_back(path)
        assert (topic, time_ns) == ('/topic', STAMP_NS)
        return found

    return write


@pytest.mark.parametrize(
    ('array', 'encoding'),
    [
        (np.arange(12, dtype=np.uint8).reshape(3, 4), 'mono8'),
        (np.arange(36, dtype=np.uint8).reshape(3, 4, 3), 'bgr8'),
        (np.linspace(-9, 9, 12, dtype=np.float32).reshape(3, 4), '32FC1'),
    ],
)
def test_image_keeps_pixels_stamp_and_frame(written, factory, array, encoding):
    found = written(factory.image(factory.header(STAMP_NS, 'cam'), array))
    assert (found.height, found.width, found.encoding, found.is_bigendian) == (3, 4, encoding, 0)
    assert found.data.tobytes() == array.tobytes()
    stamp = found.header.stamp
    assert (stamp.sec, stamp.nanosec, found.header.frame_id) == (12, 34, 'cam')


def test_compressed_image_keeps_its_bytes(written, factory):
    found = written(factory.compressed(factory.header(STAMP_NS, 'cam'), b'\x89PNG...', 'png'))
    assert (found.format, found.data.tobytes()) == ('png', b'\x89PNG...')


def test_text_keeps_its_characters(written, factory):
    assert written(factory.text('{"name": "Käfer"}')).data == '{"name": "Käfer"}'


def test_rows_keep_values_and_labels(written, factory):
    found = written(factory.rows(np.arange(6.0).reshape(2, 3), ('row', 'component')))
    assert found.data.tolist() == [0, 1, 2, 3, 4, 5]
    dimensions = [(dim.label, dim.size, dim.stride) for dim in found.layout.dim]
    assert dimensions == [('row', 2, 6), ('component', 3, 3)]


def test_camera_info_is_a_pinhole_with_its_centre_in_the_middle(written, factory):
    found = written(factory.camera_info(factory.header(STAMP_NS, 'cam'), (480, 640), 500.0))
    assert (found.height, found.width) == (480, 640)
    np.testing.assert_array_equal(
        found.k.reshape(3, 3), [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]
    )
    np.testing.assert_array_equal(found.p.reshape(3, 4)[:, :3], found.k.reshape(3, 3))
    assert not found.p.reshape(3, 4)[:, 3].any()


def test_serialised_message_is_stored_byte_by_byte(tmp_path):
    data = b'\x00\x01\x00\x00\x03\x00\x00\x00hi\x00'
    path = tmp_path / 'raw.mcap'
    with BagWriter(path) as writer:
        writer.write_cdr('/text', 'std_msgs/msg/String', data, STAMP_NS)
    with path.open('rb') as stream:
        ((_, _, message),) = make_reader(stream).iter_messages()
    assert message.data == data
    assert read_back(path)[0][2].data == 'hi'


@pytest.fixture
def recording(tmp_path, factory):
    """A bag of 40 random images on two topics, one latched: more than one chunk."""
    rng = np.random.default_rng(20170305)
    path = tmp_path / 'recording.mcap'
    config = Config().replaced({'shutter.exposure_rows': 40.0})
    with BagWriter(path, config) as writer:
        for index in range(40):
            noise = rng.integers(0, 256, (200, 300), dtype=np.uint8)
            image = factory.image(factory.header(index, ''), noise)
            writer.write('/image', image, index)
        writer.write('/reference/image', image, 40, latched=True)
    return path


def test_checksums_hold_and_chunks_are_compressed(recording):
    with recording.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 41
        summary = reader.get_summary()
        assert reader.get_header().profile == 'ros2'
    assert len(summary.chunk_indexes) > 1
    assert {index.compression for index in summary.chunk_indexes} == {'zstd'}
    assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}


def test_flipped_byte_is_noticed_by_the_checksum(recording):
    data = bytearray(recording.read_bytes())
    data[len(data) // 3] ^= 0xFF
    recording.write_bytes(data)
    with recording.open('rb') as stream, pytest.raises(ValueError, match='crc'):
        list(make_reader(stream, validate_crcs=True).iter_messages())


def test_latched_topic_is_offered_transient_local(recording):
    with AnyReader([recording]) as reader:
        durability = {
            connection.topic: connection.ext.offered_qos_profiles[0].durability
            for connection in reader.connections
        }
    assert durability == {
        '/image': QosDurability.VOLATILE,
        '/reference/image': QosDurability.TRANSIENT_LOCAL,
    }


def test_qos_is_written_in_words_as_jazzy_reads_it(recording):
    with recording.open('rb') as stream:
        channels = make_reader(stream).get_summary().channels.values()
    for channel in channels:
        (profile,) = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        words = [profile[name] for name in ('history', 'reliability', 'liveliness')]
        assert words == ['keep_last', 'reliable', 'automatic']
        assert profile['durability'] in ('transient_local', 'volatile')


def test_version_and_configuration_are_in_the_file(recording):
    with recording.open('rb') as stream:
        (record,) = make_reader(stream).iter_metadata()
    assert record.name == 'rsmb'
    assert record.metadata['version'] == rsmb_ros.__version__
    config = Config.from_mapping(json.loads(record.metadata['config']))
    assert config.shutter.exposure_rows == 40.0


def test_every_output_has_a_type_that_can_be_written(tmp_path):
    with BagWriter(tmp_path / 'types.mcap') as writer:
        for output in OUTPUTS:
            writer.write_cdr(f'/{output.name}', output.type, b'', 0)
    with AnyReader([tmp_path / 'types.mcap']) as reader:
        assert {c.msgtype for c in reader.connections} == {output.type for output in OUTPUTS}


@pytest.mark.parametrize('interruption', [KeyboardInterrupt, ValueError])
def test_interrupted_recording_is_shorter_and_whole(tmp_path, factory, interruption):
    path = tmp_path / 'cut.mcap'
    with pytest.raises(interruption), BagWriter(path) as writer:
        writer.write('/text', factory.text('first'), 1)
        writer.write('/text', factory.text('second'), 2)
        raise interruption
    assert [message.data for _, _, message in read_back(path)] == ['first', 'second']


def test_old_file_stays_until_the_new_one_is_finished(tmp_path, factory):
    path = tmp_path / 'same.mcap'
    path.write_text('old')
    with BagWriter(path) as writer:
        writer.write('/text', factory.text('new'), 1)
        assert path.read_text() == 'old'
    assert [message.data for _, _, message in read_back(path)] == ['new']
    assert list(tmp_path.iterdir()) == [path]


def test_other_suffix_is_refused(tmp_path):
    with pytest.raises(BagError, match=r'out\.bag: an output bag must be named \*\.mcap'):
        BagWriter(tmp_path / 'out.bag')


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(BagError, match=r'absent/out\.mcap: cannot be written: No such file'):
        BagWriter(tmp_path / 'absent' / 'out.mcap')


def test_recording_in_work_is_not_written_by_another(tmp_path, factory):
    path = tmp_path / 'same.mcap'
    with BagWriter(path) as writer:
        writer.write('/text', factory.text('first'), 1)
        writer.flush()
        with pytest.raises(BagError, match=r'same\.mcap: another process is writing it'):
            BagWriter(path)
        writer.write('/text', factory.text('second'), 2)
    assert [message.data for _, _, message in read_back(path)] == ['first', 'second']


def test_detections_are_read_back_by_the_definition_in_the_file(written, factory):
    fields = DetectionFields('3', 12.0, 21.5, 5.0, 4.0, 'change', 0.75)
    found = written(factory.detections(factory.header(STAMP_NS, 'cam'), [fields]))
    (detection,) = found.detections
    for header in (found.header, detection.header):
        assert (header.stamp.sec, header.frame_id) == (12, 'cam')
    assert detection.id == '3'
    assert (detection.bbox.center.position.x, detection.bbox.center.position.y) == (12.0, 21.5)
    assert (detection.bbox.size_x, detection.bbox.size_y) == (5.0, 4.0)
    (what,) = detection.results
    assert (what.hypothesis.class_id, what.hypothesis.score) == ('change', 0.75)


def test_diagnostics_are_read_back(written, factory):
    state = StatusFields(1, 'name', 'no texture', 'hardware', {'gain': '1.0', 'frame': '7'})
    (status,) = written(factory.diagnostics(factory.header(STAMP_NS, ''), state)).status
    assert (status.level, status.name, status.message) == (1, 'name', 'no texture')
    assert [(pair.key, pair.value) for pair in status.values] == [('gain', '1.0'), ('frame', '7')]
