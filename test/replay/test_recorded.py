"""What a replay writes can be opened by others, and says what was found."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from containers import in_container
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from small_flight import START_NS, STEP_NS, masks_of

import rsmb_ros
from rsmb_ros.bags.pacing import paced
from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.cli.main import main
from rsmb_ros.core import Config
from rsmb_ros.core.errors import BagError, ConfigError
from rsmb_ros.messages.images import image_from_compressed, image_from_msg
from rsmb_ros.replay.job import ReplayJob, replay
from rsmb_ros.replay.recorded import recorded

LAYOUT = Path(__file__).parents[2] / 'config' / 'foxglove.json'
IMAGE, COMPRESSED = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage'
TYPES = {
    '/rsmb/registered': IMAGE,
    '/rsmb/rectified': IMAGE,
    '/rsmb/change_mask': IMAGE,
    '/rsmb/valid_mask': IMAGE,
    '/rsmb/residual': IMAGE,
    '/rsmb/overlay': IMAGE,
    '/rsmb/row_motion': 'std_msgs/msg/Float32MultiArray',
    '/rsmb/regions_json': 'std_msgs/msg/String',
    '/rsmb/row_uncertainty': 'std_msgs/msg/Float32MultiArray',
    '/rsmb/regions': 'vision_msgs/msg/Detection2DArray',
    '/rsmb/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


@pytest.fixture(scope='module')
def made(flight_bag, tmp_path_factory):
    """Return a maker of outputs: ``made(**options) -> path``; each is made once."""
    kept = {}

    def make(**options):
        key = tuple(options.items())
        if key not in kept:
            kept[key] = tmp_path_factory.mktemp('made') / 'out.mcap'
            replay(ReplayJob(flight_bag, kept[key], **options))
        return kept[key]

    return make


def read(path):
    """Return {topic: [message]} as rosbags reads it, by the definitions in the file alone."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


def test_file_is_what_the_format_demands(made):
    with made().open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = [
            (
                schema.name,
                schema.encoding,
                channel.topic,
                channel.message_encoding,
                message.sequence,
            )
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
        summary = reader.get_summary()
        assert reader.get_header().profile == 'ros2'
    assert {topic: kind for kind, _, topic, _, _ in messages} == TYPES
    assert {(schema, encoding) for _, schema, _, encoding, _ in messages} == {('ros2msg', 'cdr')}
    assert len(summary.chunk_indexes) == 6, 'a chunk for each frame'
    assert [number for *_, topic, _, number in messages if topic == '/rsmb/overlay'] == [*range(6)]


def test_version_configuration_input_and_options_are_in_it(made, flight_bag):
    with made().open('rb') as stream:
        (record,) = make_reader(stream).iter_metadata()
    notes = {name: value for name, value in record.metadata.items() if name != 'version'}
    values = {name: json.loads(value) for name, value in notes.items()}
    assert (record.name, record.metadata['version']) == ('rsmb', rsmb_ros.__version__)
    assert Config.from_mapping(values['config']) == Config()
    assert values['input']['name'] == 'flight.mcap'
    assert values['input']['bytes'] == flight_bag.stat().st_size
    assert values['topic'] == '/image'
    assert values['reference'] == '/reference/image'
    assert (values['compress'], values['keep_input']) == (None, False)


def test_two_runs_write_equal_bytes(made, flight_bag, tmp_path):
    replay(ReplayJob(flight_bag, tmp_path / 'again.mcap'))
    assert (tmp_path / 'again.mcap').read_bytes() == made().read_bytes()


def test_play_reads_every_moment(made):
    with Bag(made()) as bag:
        moments = list(paced(bag.cdr(*TYPES), '/rsmb/overlay'))
    assert [round(moment.offset_s / (STEP_NS * 1e-9)) for moment in moments] == [*range(6)]
    assert all({topic for topic, _ in moment.messages} == set(TYPES) for moment in moments)


def test_changes_are_boxes_around_the_mask(made):
    found = read(made())
    boxes = 0
    for mask, regions in zip(found['/rsmb/change_mask'], found['/rsmb/regions'], strict=True):
        assert regions.header.stamp == mask.header.stamp
        left = image_from_msg(mask).copy()
        for detection in regions.detections:
            box, (what,) = detection.bbox, detection.results
            x = round(box.center.position.x - (box.size_x - 1) / 2)
            y = round(box.center.position.y - (box.size_y - 1) / 2)
            inside = left[y : y + int(box.size_y), x : x + int(box.size_x)]
            for edge in (inside[0], inside[-1], inside[:, 0], inside[:, -1]):
                assert edge.any()
            inside[:] = 0
            assert (what.hypothesis.class_id, 0 < what.hypothesis.score <= 1) == ('change', True)
            assert what.pose.pose.orientation.w == 1.0
            boxes += 1
        assert not left.any()
    assert boxes >= 4


def test_diagnostics_tell_status_residual_and_exposure(made):
    found = read(made())
    for n, array in enumerate(found['/rsmb/diagnostics']):
        (status,) = array.status
        values = {pair.key: pair.value for pair in status.values}
        assert (status.level, status.message, values['frame']) == (0, 'registered', str(n))
        valid = image_from_msg(found['/rsmb/valid_mask'][n]) > 0
        residual = found['/rsmb/residual'][n].data.view('<f4').reshape(valid.shape)
        assert float(values['residual mean [grey levels]']) == pytest.approx(
            np.abs(residual[valid]).mean(), abs=0.006
        )
        assert float(values['judged [%]']) == pytest.approx(100 * valid.mean(), abs=0.06)
        assert float(values['exposure [rows]']) >= 0
        stamp = array.header.stamp.sec * 10**9 + array.header.stamp.nanosec
        assert stamp == START_NS + (n + 1) * STEP_NS


def test_diagnostics_warn_of_a_frame_that_is_not_registered(photos, factory, tmp_path):
    with BagWriter(tmp_path / 'flat.mcap') as writer:
        for n, topic in enumerate(('/reference/image', '/image')):
            photo = np.full_like(photos[0], 99) if n else photos[0]
            writer.write(topic, factory.image(factory.header(n, ''), photo), n)
    replay(ReplayJob(tmp_path / 'flat.mcap', tmp_path / 'out.mcap'))
    (array,) = read(tmp_path / 'out.mcap')['/rsmb/diagnostics']
    (status,) = array.status
    values = {pair.key: pair.value for pair in status.values}
    assert (status.level, values['status']) == (1, 'not_registered')
    assert 'no texture' in values['reason']
    assert status.message == f'not_registered: {values["reason"]}'
    assert values['exposure [rows]'] == values['residual mean [grey levels]'] == ''


@pytest.mark.parametrize('form', ['png', 'jpeg'])
def test_compressed_photos_are_smaller_and_masks_lose_nothing(made, form):
    raw, small = read(made()), read(made(compress=form))
    for name in ('change_mask', 'valid_mask', 'registered', 'rectified', 'overlay'):
        assert f'/rsmb/{name}' not in small
        for before, after in zip(
            raw[f'/rsmb/{name}'], small[f'/rsmb/{name}/compressed'], strict=True
        ):
            wanted, found = image_from_msg(before), image_from_compressed(after)
            lossless = form == 'png' or name.endswith('mask')
            assert found.shape == wanted.shape
            assert len(after.data) < wanted.size
            assert np.abs(found.astype(int) - wanted).mean() <= (0 if lossless else 3)
            assert after.format.split('; ')[1].startswith('png' if lossless else 'jpeg')
    residuals = zip(raw['/rsmb/residual'], small['/rsmb/residual'], strict=True)
    assert all(a.data.tobytes() == b.data.tobytes() for a, b in residuals)


# -- inputs that are kept --------------------------------------------------------------------------


def test_inputs_are_kept_byte_by_byte(made, flight_bag):
    topics = ('/image', '/reference/image')
    with Bag(flight_bag) as before, Bag(made(keep_input=True)) as after:
        assert list(before.cdr(*topics)) == list(after.cdr(*topics))
    assert masks_of(made(keep_input=True)).keys() == masks_of(made()).keys()


def test_outputs_stand_beside_their_inputs_whatever_the_stamps(photos, factory, tmp_path):
    bag = tmp_path / 'bag.mcap'
    with BagWriter(bag) as writer:
        for n, photo in enumerate(photos):
            topic = '/image' if n else '/reference/image'
            writer.write(topic, factory.image(factory.header(n, ''), photo), START_NS + n)
    replay(ReplayJob(bag, tmp_path / 'out.mcap', keep_input=True))
    with Bag(tmp_path / 'out.mcap') as found:
        for topic in ('/image', '/rsmb/overlay', '/rsmb/diagnostics'):
            times = [(frame[1], frame[2].header.stamp.nanosec) for frame in found.messages(topic)]
            assert times == [(START_NS + n, n) for n in range(1, 7)]


def test_output_with_its_inputs_can_be_replayed_again(made, flight_bag, tmp_path):
    replay(ReplayJob(made(keep_input=True), tmp_path / 'o.mcap', topic='/image'))
    for before, after in zip(masks_of(made()).values(), masks_of(tmp_path / 'o.mcap').values(),
                             strict=True):  # fmt: skip
        np.testing.assert_array_equal(before, after)


def test_only_frames_with_a_result_are_kept(photos, factory, tmp_path):
    bag = tmp_path / 'bag.mcap'
    with BagWriter(bag) as writer:
        for n, photo in enumerate(photos):
            photo = photo[:20, :20] if n == 2 else photo
            topic = '/image' if n else '/reference/image'
            writer.write(topic, factory.image(factory.header(n, 'cam'), photo), n)
            writer.write('/other', factory.text('not used'), n)
    replay(ReplayJob(bag, tmp_path / 'out.mcap', keep_input=True))
    found = read(tmp_path / 'out.mcap')
    assert [m.header.stamp.nanosec for m in found['/image']] == [1, 3, 4, 5, 6]
    assert '/other' not in found


def test_inputs_of_files_that_are_no_bag_cannot_be_kept(image_folder, tmp_path):
    with pytest.raises(ConfigError, match='--keep-input is for bags'):
        replay(ReplayJob(image_folder, tmp_path / 'o.mcap', reference='@0', keep_input=True))
    assert list(tmp_path.iterdir()) == []


def test_inputs_named_like_outputs_are_refused(photos, factory, tmp_path):
    bag = tmp_path / 'bag.mcap'
    with BagWriter(bag) as writer:
        for n, topic in enumerate(('/reference/image', '/rsmb/overlay')):
            writer.write(topic, factory.image(factory.header(n, ''), photos[n]), n)
    with pytest.raises(ConfigError, match=r'topic /rsmb/overlay of \S+ has the name of an output'):
        replay(ReplayJob(bag, tmp_path / 'o.mcap', keep_input=True))


# -- the layout ------------------------------------------------------------------------------------


def strings(value):
    if isinstance(value, dict):
        for inner in value.values():
            yield from strings(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from strings(inner)
    elif isinstance(value, str):
        yield value


@pytest.mark.parametrize(('name', 'compress'), [('foxglove', None), ('foxglove_compressed', 'png')])
def test_layout_shows_only_what_a_replay_writes(name, compress):
    layout = json.loads(LAYOUT.with_name(f'{name}.json').read_text())
    topics = {
        re.match(r'/[\w/]+', text)[0]
        for panel in layout['configById'].values()
        for text in strings(panel)
        if text.startswith('/')
    }
    names = {output.topic: output.name for output in recorded(compress)}
    assert topics - set(names) == {'/image/compressed'}  # the live image, with --keep-input
    shown = {names[topic] for topic in topics if topic in names}
    wanted = {'overlay', 'change_mask', 'registered', 'row_motion', 'diagnostics', 'regions'}
    assert wanted <= shown


def test_layouts_differ_only_in_the_names_of_images():
    text = LAYOUT.read_text()
    for raw, small in zip(recorded(), recorded('jpeg'), strict=True):
        text = text.replace(f'"{raw.topic}"', f'"{small.topic}"')
    assert LAYOUT.with_name('foxglove_compressed.json').read_text() == text


def test_layout_places_every_panel_once():
    layout = json.loads(LAYOUT.read_text())
    placed = [text for text in strings(layout['layout']) if '!' in text]
    assert sorted(placed) == sorted(layout['configById'])


def test_values_that_the_layout_plots_are_there(made):
    text = LAYOUT.read_text()
    wanted = set(re.findall(r'key==\\"([^"]+)\\"', text))
    (status,) = read(made())['/rsmb/diagnostics'][0].status
    assert wanted <= {pair.key for pair in status.values}
    assert wanted
    selected = json.loads(text)['configById']['DiagnosticStatusPanel!frame']
    assert (selected['selectedHardwareId'], selected['selectedName']) == (
        status.hardware_id,
        status.name,
    )


def test_unreadable_bag_leaves_no_output(tmp_path):
    (tmp_path / 'broken.mcap').write_bytes(b'nothing')
    with pytest.raises(BagError):
        replay(ReplayJob(tmp_path / 'broken.mcap', tmp_path / 'o.mcap'))
    assert [path.name for path in tmp_path.iterdir()] == ['broken.mcap']


@pytest.mark.parametrize('colour', [False, True])
def test_colour_is_kept_as_it_is(photos, factory, tmp_path, colour):
    bag = tmp_path / 'bag.mcap'
    with BagWriter(bag) as writer:
        for n, topic in enumerate(('/reference/image', '/image')):
            photo = cv2.cvtColor(photos[n], cv2.COLOR_GRAY2BGR) if colour else photos[n]
            writer.write(topic, factory.image(factory.header(n, ''), photo), n)
    replay(ReplayJob(bag, tmp_path / 'o.mcap', compress='png'))
    found = read(tmp_path / 'o.mcap')
    encoding = 'bgr8' if colour else 'mono8'
    for name in ('registered', 'rectified'):
        (message,) = found[f'/rsmb/{name}/compressed']
        assert message.format.startswith(f'{encoding}; png compressed')
        assert image_from_compressed(message).ndim == (3 if colour else 2)


@pytest.mark.parametrize('kind', ['folder db3 message zstd', 'folder mcap split', 'db3'])
def test_inputs_are_kept_from_every_container(made, flight_bag, tmp_path, kind):
    bag = in_container(flight_bag, kind, tmp_path)
    replay(ReplayJob(bag, tmp_path / 'out.mcap', keep_input=True))
    topics = ('/image', '/reference/image')
    with Bag(made(keep_input=True)) as wanted, Bag(tmp_path / 'out.mcap') as found:
        assert list(found.cdr(*topics)) == list(wanted.cdr(*topics))


def test_inputs_of_ros_1_are_to_be_converted_first(flight_bag, tmp_path):
    bag = in_container(flight_bag, 'bag', tmp_path)
    with pytest.raises(BagError, match='a ROS 1 bag; convert it first: rosbags-convert'):
        replay(ReplayJob(bag, tmp_path / 'out.mcap', keep_input=True))


def test_options_of_the_command_reach_the_output(made, flight_bag, tmp_path):
    out = tmp_path / 'out.mcap'
    command = ['replay', flight_bag, '-o', out, '--compress', 'jpeg', '--keep-input']
    assert main([str(word) for word in command]) == 0
    assert '/image' in read(out)
    assert '/rsmb/overlay/compressed' in read(out)
