"""`rsmb replay`: every frame of a bag through the one detector, into another bag."""

import csv
import json
import re
import signal

import numpy as np
import pytest
from mcap.reader import make_reader

from rsmb_ros.bags.image_files import read_image
from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.messages.as_json import summary_to_dict
from rsmb_ros.messages.outputs import OUTPUTS
from rsmb_ros.replay import detection


def images_of(path, topic):
    with Bag(path) as bag:
        return {frame.stamp_ns: frame.image for frame in bag.frames(topic)}


@pytest.fixture(scope='session')
def expected(flight, focal_px):
    """What the detector makes of each frame."""
    detector = Detector(flight.reference, Camera(focal_px))
    return [detector.detect(image) for image in flight.live]


@pytest.fixture
def replay(rsmb, tmp_path):
    """Run ``rsmb replay BAG``; returns outcome and recording."""

    def run(bag, *options):
        return rsmb('replay', bag, '-o', tmp_path / 'out.mcap', *options), tmp_path / 'out.mcap'

    return run


def test_masks_are_those_of_the_detector_frame_by_frame(replay, flight, flight_bag, expected):
    done, out = replay(flight_bag)
    assert done.code == 0
    for name in ('change_mask', 'valid_mask', 'registered', 'rectified'):
        found = images_of(out, f'/rsmb/{name}')
        assert list(found) == flight.stamps()
        for image, result in zip(found.values(), expected, strict=True):
            np.testing.assert_array_equal(image, getattr(result, name))


def test_every_output_is_recorded_at_the_stamp_of_its_frame(replay, flight, flight_bag):
    _, out = replay(flight_bag)
    with Bag(out) as bag:
        written = {topic.name: topic.type for topic in bag.topics}
        for output in OUTPUTS:  # of the node
            assert written.pop(f'/rsmb/{output.name}') == output.type
        assert written == {
            '/rsmb/row_uncertainty': 'std_msgs/msg/Float32MultiArray',
            '/rsmb/regions': 'vision_msgs/msg/Detection2DArray',
            '/rsmb/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
        }
        for topic in [topic.name for topic in bag.topics]:
            assert [time_ns for _, time_ns, _ in bag.messages(topic)] == flight.stamps()
        for _, time_ns, message in bag.messages('/rsmb/residual'):
            assert (message.encoding, message.header.frame_id) == ('32FC1', 'cam')
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time_ns
    with out.open('rb') as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) > 0


def test_summaries_are_those_of_the_detector(replay, flight_bag, expected):
    _, out = replay(flight_bag)
    with Bag(out) as bag:
        messages = [message for _, _, message in bag.messages('/rsmb/regions_json')]
    for message, result in zip(messages, expected, strict=True):
        found, wanted = json.loads(message.data), summary_to_dict(result)
        assert found['frame_id'] == 'cam'
        for name in ('status', 'reason', 'regions', 'exposure_rows', 'gain'):
            assert found[name] == wanted[name]


def test_replay_and_detect_agree_byte_by_byte(
    replay, rsmb, flight, flight_bag, image_files, focal_px, tmp_path
):
    _, out = replay(flight_bag)
    replayed = images_of(out, '/rsmb/change_mask')
    for index, stamp in enumerate(flight.stamps()):
        pair = (image_files / 'reference.png', image_files / f'live_{index}.png')
        focal = f'camera.focal_px={focal_px}'
        assert rsmb('detect', *pair, '-o', tmp_path / 'd', '--set', focal).code == 0
        detected = read_image(tmp_path / 'd' / 'change_mask.png')
        assert detected.tobytes() == replayed[stamp].tobytes()


def test_csv_has_a_line_per_region_and_per_frame_without(
    replay, flight, flight_bag, expected, tmp_path
):
    replay(flight_bag, '--csv', tmp_path / 'regions.csv')
    with (tmp_path / 'regions.csv').open(newline='') as stream:
        lines = list(csv.DictReader(stream))
    wanted = [
        (index, stamp, region)
        for index, (stamp, result) in enumerate(zip(flight.stamps(), expected, strict=True))
        for region in result.regions or (None,)
    ]
    assert len(lines) == len(wanted)
    for line, (index, stamp, region) in zip(lines, wanted, strict=True):
        assert (line['frame'], line['stamp_ns']) == (str(index), str(stamp))
        assert line['status'] == 'registered'
        if region is None:
            assert line['kind'] == line['x'] == line['score'] == ''
        else:
            assert line['kind'] == region.kind
            box = [int(line[name]) for name in ('x', 'y', 'width', 'height', 'area')]
            assert box == [region.x, region.y, region.width, region.height, region.area]
            assert float(line['score']) == pytest.approx(region.score)


def test_regions_that_last_are_named_with_the_stamp_of_their_first_frame(
    replay, flight, flight_bag, focal_px, tmp_path
):
    lasting = ('change.persistence_frames=3', 'change.persistence_seen=2')
    options = [word for one in lasting for word in ('--set', one)]
    _, out = replay(flight_bag, '--csv', tmp_path / 'regions.csv', *options)
    config = Config.from_mapping(
        {'change': {'persistence_seen': 2, 'persistence_frames': 3}, 'camera.focal_px': focal_px}
    )
    detector = Detector(flight.reference, config=config)
    wanted = [
        detector.detect(image, stamp)
        for image, stamp in zip(flight.live, flight.stamps(), strict=True)
    ]
    with (tmp_path / 'regions.csv').open(newline='') as stream:
        lines = [line for line in csv.DictReader(stream) if line['id']]
    found = [(line['id'], line['first_seen'], float(line['reference_x'])) for line in lines]
    regions = [region for result in wanted for region in result.changes]
    assert found == [(str(one.id), str(one.first_seen), one.reference_x) for one in regions]
    assert regions
    masks = images_of(out, '/rsmb/change_mask').values()
    for mask, result in zip(masks, wanted, strict=True):
        np.testing.assert_array_equal(mask, result.change_mask)


def test_report_shows_the_frames(replay, flight_bag, tmp_path):
    done, _ = replay(flight_bag, '--report', tmp_path / 'report.html')
    page = (tmp_path / 'report.html').read_text()
    assert done.code == 0
    assert 'Replay of flight.mcap' in page
    assert re.findall(r'id="frame-(\d+)"', page) == ['0', '1', '2', '3']
    assert 'id="change-1"' in page


def test_report_without_a_folder_is_refused_before_the_work(replay, flight_bag, tmp_path):
    path = tmp_path / 'gone' / 'r.html'
    done, _ = replay(flight_bag, '--report', path)
    assert done.code == 1
    assert f'{path}: cannot be written: there is no folder {path.parent}' in done.err


def test_one_line_says_what_came_out_and_a_pipe_stays_quiet(replay, flight_bag):
    done, out = replay(flight_bag)
    assert done.out.count('\n') == 1
    assert 'frames: 4' in done.out
    assert 'registered: 4' in done.out
    assert str(out) in done.out
    assert done.err == ''


def test_configuration_is_used_and_kept_in_the_recording(replay, flight_bag):
    _, out = replay(flight_bag, '--set', 'registration.min_agreement=1.0')
    with out.open('rb') as stream:
        (record,) = make_reader(stream).iter_metadata()
    config = Config.from_mapping(json.loads(record.metadata['config']))
    assert config.registration.min_agreement == 1.0
    with Bag(out) as bag:
        states = {json.loads(m.data)['status'] for _, _, m in bag.messages('/rsmb/regions_json')}
    assert 'not_registered' in states


def test_reference_may_be_a_file(replay, flight_bag, image_files, expected):
    done, out = replay(flight_bag, '--reference', image_files / 'reference.png')
    assert done.code == 0
    masks = images_of(out, '/rsmb/change_mask').values()
    for mask, result in zip(masks, expected, strict=True):
        np.testing.assert_array_equal(mask, result.change_mask)


def test_a_newer_reference_takes_over(replay, flight, tmp_path, factory):
    path = tmp_path / 'two.mcap'
    series = [
        ('/reference/image', flight.reference),
        ('/image', flight.live[2]),
        ('/reference/image', flight.live[2]),
        ('/image', flight.live[2]),
    ]
    with BagWriter(path) as bag:
        for time, (topic, image) in enumerate(series, 1):
            bag.write(topic, factory.image(factory.header(time, ''), image), time)
    _, out = replay(path)
    first, second = images_of(out, '/rsmb/change_mask').values()
    assert first.any()
    assert not second.any()


def test_unreadable_frame_is_skipped_with_a_warning(replay, flight, tmp_path, factory, caplog):
    path = tmp_path / 'some.mcap'
    with BagWriter(path) as bag:
        for time, image in enumerate((flight.reference, flight.live[0], flight.live[1])):
            topic = '/image' if time else '/reference/image'
            bag.write(topic, factory.image(factory.header(time, ''), image), time)
        tiny = factory.image(factory.header(3, ''), np.zeros((8, 8), np.uint8))
        bag.write('/image', tiny, 3)
        tiny.step = 2
        bag.write('/image', tiny, 4)
    done, out = replay(path)
    assert done.code == 0
    assert list(images_of(out, '/rsmb/change_mask')) == [1, 2]
    assert 'frames: 2, 2 more could not be read' in done.out
    told = [record.getMessage() for record in caplog.records]
    assert ['frame 2 of /image' in told[0], 'message 3 of /image' in told[1]] == [True, True]


def test_interrupted_replay_leaves_a_readable_bag(replay, flight_bag, monkeypatch, tmp_path):
    class Interrupted(Detector):
        calls = 0

        def detect(self, live, stamp=None):
            Interrupted.calls += 1
            if Interrupted.calls == 3:
                raise KeyboardInterrupt
            return super().detect(live, stamp)

    monkeypatch.setattr(detection, 'Detector', Interrupted)
    done, out = replay(flight_bag, '--csv', tmp_path / 'r.csv', '--report', tmp_path / 'r.html')
    assert done.code == 130
    assert 'interrupted; what was finished is kept; --resume goes on with it' in done.err
    assert len(images_of(out, '/rsmb/change_mask')) == 2
    assert len((tmp_path / 'r.csv').read_text().splitlines()) >= 3
    assert '</html>' in (tmp_path / 'r.html').read_text()


def test_ctrl_c_waits_for_the_frame_in_work(replay, flight_bag, monkeypatch):
    class Signalled(Detector):
        calls = 0

        def detect(self, live, stamp=None):
            Signalled.calls += 1
            if Signalled.calls == 3:
                signal.raise_signal(signal.SIGINT)
            return super().detect(live, stamp)

    monkeypatch.setattr(detection, 'Detector', Signalled)
    before = signal.getsignal(signal.SIGINT)
    done, out = replay(flight_bag)
    assert done.code == 130
    assert Signalled.calls == 3
    assert [len(images_of(out, f'/rsmb/{name}')) for name in ('overlay', 'valid_mask')] == [2, 2]
    assert signal.getsignal(signal.SIGINT) is before


def test_part_of_a_bag_against_one_of_its_frames_by_two_workers(
    replay, flight, flight_bag, tmp_path
):
    options = ['--reference', '@0', '--start', '0.2', '--stride', '2', '--max-frames', '2']
    masks = []
    for workers in (1, 2):
        done, out = replay(flight_bag, *options, '--workers', workers)
        assert (done.code, done.err) == (0, '')
        masks.append(images_of(out, '/rsmb/change_mask'))
        assert list(masks[-1]) == flight.stamps()[1::2]
    for one, other in zip(masks[0].values(), masks[1].values(), strict=True):
        assert one.tobytes() == other.tobytes()


def test_folder_of_images_is_replayed(replay, image_files):
    options = ['--reference', image_files / 'reference.png', '--rate', '2', '--max-frames', '3']
    done, out = replay(image_files, *options)
    assert done.code == 0
    # live_0, live_1, live_2
    assert list(images_of(out, '/rsmb/change_mask')) == [0, 500_000_000, 1_000_000_000]


def test_bag_cut_off_is_replayed_as_far_as_it_goes(replay, flight_bag, tmp_path, caplog):
    path = tmp_path / 'cut.mcap'
    data = flight_bag.read_bytes()
    path.write_bytes(data[: len(data) - 400])  # within the index
    done, out = replay(path)
    assert done.code == 0
    assert len(images_of(out, '/rsmb/change_mask')) == 4
    assert 'frames: 4, 0 more could not be read, the recording is damaged: see the warn' in done.out
    assert f'{path}: no index: the file is cut off' in caplog.text


def test_check_writes_nothing_and_tells_by_its_code(rsmb, flight_bag, tmp_path):
    done = rsmb('replay', '--check', flight_bag)
    assert (done.code, done.err) == (0, '')
    assert '/image/compressed (sensor_msgs/msg/CompressedImage): 4 of 4 messages whole' in done.out
    assert done.out.endswith(f'{flight_bag}: whole\n')
    data = bytearray(flight_bag.read_bytes())
    data[len(data) // 3] ^= 1
    (tmp_path / 'hurt.mcap').write_bytes(data)
    done = rsmb('replay', '--check', tmp_path / 'hurt.mcap')
    assert done.code == 1
    assert 'hurt.mcap: damaged' in done.out


# -- bad input ---------------------------------------------------------------------------------


def test_missing_bag_is_named(replay, tmp_path):
    done, out = replay(tmp_path / 'gone.mcap')
    assert done.code == 1
    assert done.err.startswith(f'rsmb: error: {tmp_path / "gone.mcap"}: no such file or folder')
    assert not out.exists()


def test_empty_bag_is_named(replay, tmp_path):
    with BagWriter(tmp_path / 'empty.mcap'):
        pass
    done, out = replay(tmp_path / 'empty.mcap')
    assert (done.code, out.exists()) == (1, False)
    assert 'empty.mcap: the bag has no messages' in done.err


def test_absent_topic_lists_those_of_the_bag(replay, flight_bag):
    done, out = replay(flight_bag, '--topic', '/front/image')
    assert (done.code, out.exists()) == (1, False)
    assert 'topic /front/image is not in the bag; it has ' in done.err
    assert '/image/compressed (sensor_msgs/msg/CompressedImage, 4 messages)' in done.err


def test_reference_that_is_neither_file_nor_topic_is_told(replay, flight_bag):
    done, _ = replay(flight_bag, '--reference', 'tile.png')
    assert done.code == 1
    assert '--reference tile.png is neither a file nor a topic' in done.err


def test_one_topic_for_both_is_wrong_usage(replay, flight_bag):
    topic = '/image/compressed'
    done, _ = replay(flight_bag, '--reference', topic, '--topic', topic)
    assert done.code == 2
    assert f'--topic and --reference are both {topic}' in done.err


def test_bag_is_never_written_over_itself(rsmb, flight_bag):
    before = flight_bag.read_bytes()
    done = rsmb('replay', flight_bag, '-o', flight_bag)
    assert done.code == 2
    assert 'is the bag to be read; choose another name' in done.err
    assert flight_bag.read_bytes() == before


@pytest.mark.parametrize(
    ('options', 'told'),
    [
        ([], '-o OUT.mcap is missing: where to write; or --check to write nothing'),
        (['--check', '-o', 'o.mcap'], '--check writes nothing: leave -o o.mcap'),
        (['-o', 'o.mcap', '--start', '1e99'], "'1e99' must be seconds, from 0 to 9999999999"),
        (['-o', 'o.mcap', '--start', '70'], '--start 70 s: no frame of /image/compressed'),
        (['-o', 'o.mcap', '--workers', '0'], "'0' must be a number from 1 to 256"),
        (['-o', 'o.mcap', '--rate', '5'], 'is a bag, whose frames have stamps'),
        (['-o', 'o.mcap', '--workers', '2', '--set', 'stream.hold=true'], 'use --workers 1'),
    ],
)
def test_wrong_usage_is_told(rsmb, flight_bag, options, told):
    done = rsmb('replay', flight_bag, *options)
    assert done.code == 2
    assert told in ' '.join(done.err.split())


def test_output_must_be_an_mcap(rsmb, flight_bag, tmp_path):
    done = rsmb('replay', flight_bag, '-o', tmp_path / 'out.bag')
    assert done.code == 2
    assert 'must end in .mcap' in done.err


def test_output_in_a_missing_folder_is_named(rsmb, flight_bag, tmp_path):
    done = rsmb('replay', flight_bag, '-o', tmp_path / 'gone' / 'out.mcap')
    assert done.code == 1
    assert 'gone/out.mcap: cannot be written: there is no folder ' in done.err
