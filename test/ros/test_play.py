"""`rsmb play`: what is in a bag reaches other processes as it was recorded."""

import json
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from rsmb_ros.bags.writing import BagFactory, BagWriter

READY_S, ANSWER_S = 240.0, 60.0
START_NS, STEP_NS = 1_600_000_000_000_000_000, 200_000_000
FRAMES = 5


@pytest.fixture(scope='module')
def bag(scene, tmp_path_factory):
    """Return a bag with a reference, camera_info, five frames and truth, 0.2 s apart."""
    path = tmp_path_factory.mktemp('bag') / 'flight.mcap'
    factory = BagFactory()
    with BagWriter(path) as writer:
        reference = factory.image(factory.header(START_NS, 'map'), scene.reference)
        writer.write('/reference/image', reference, START_NS, latched=True)
        for index in range(1, FRAMES + 1):
            stamp = START_NS + index * STEP_NS
            header = factory.header(stamp, 'cam')
            writer.write('/camera_info', factory.camera_info(header, scene.shape, 300.0), stamp)
            writer.write('/image', factory.image(header, scene.live), stamp)
            writer.write('/truth/scene', factory.text('{}'), stamp)
    return path


def play(*arguments):
    """Start `rsmb play` as users do."""
    return subprocess.Popen(
        [sys.executable, '-m', 'rsmb_ros.cli.main', 'play', *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process):
    """Return exit code, stdout and stderr."""
    out, err = process.communicate(timeout=ANSWER_S)
    return process.returncode, out, err


@pytest.fixture
def listener(start_peer):
    """Return a peer and the list it collects images and reference in, as played under /cam."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import Image

    peer = start_peer(only=[])
    images, references = [], []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    made = [
        peer.node.create_subscription(Image, '/cam/image', images.append, 50),
        peer.node.create_subscription(Image, '/cam/reference', references.append, latched),
    ]
    yield peer, images, references
    for subscription in made:
        peer.node.destroy_subscription(subscription)


REMAP = [
    *['--remap', '/image:=/cam/image', '--remap', 'reference/image:=/cam/reference'],
    *['--remap', '/camera_info:=/cam/info'],
]


def test_node_answers_every_frame_of_a_bag_that_is_played(start_node, start_peer, bag):
    node = start_node()
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['regions_json'])
    peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    process = play(bag, '--rate', 2)
    answers = peer.outputs['regions_json']
    peer.wait_until(lambda: len(answers) >= FRAMES, ANSWER_S, 'an answer to each frame')
    code, out, err = ended(process)
    assert code == 0, err
    assert 'played 11 messages in ' in out
    assert 'truth' not in out
    found = [json.loads(answer.data) for answer in answers]
    stamps = [one['stamp']['sec'] * 10**9 + one['stamp']['nanosec'] for one in found]
    assert stamps == [START_NS + index * STEP_NS for index in range(1, FRAMES + 1)]
    assert {one['status'] for one in found} == {'registered'}


def test_images_arrive_byte_for_byte_at_the_pace_they_were_recorded(listener, bag, scene):
    peer, images, references = listener
    arrived = []
    process = play(bag, *REMAP, '--wait', '8')  # on a busy machine discovery takes seconds

    def all_there():
        arrived.extend([time.monotonic()] * (len(images) - len(arrived)))
        return len(images) == FRAMES and references

    peer.wait_until(all_there, ANSWER_S, 'five images and the reference')
    code, out, err = ended(process)
    assert code == 0, err
    assert 'nobody listens to /cam/info' in out
    for msg in images:
        np.testing.assert_array_equal(np.frombuffer(msg.data, np.uint8), scene.live.reshape(-1))
        assert (msg.header.frame_id, msg.encoding) == ('cam', 'mono8')
    assert references[0].header.stamp.sec == START_NS // 10**9
    # 4 steps; a busy machine may be late, never early
    assert arrived[-1] - arrived[0] > 0.7 * (FRAMES - 1) * STEP_NS * 1e-9


def test_present_stamps_loop_and_ctrl_c(listener, bag):
    peer, images, _ = listener
    before = time.time()
    process = play(bag, *REMAP, '--now', '--loop', '--rate', 50, '--wait', '1')
    peer.wait_until(lambda: len(images) > 3 * FRAMES, ANSWER_S, 'three turns')
    process.send_signal(signal.SIGINT)
    code, _, err = ended(process)
    assert code == 130, err
    assert 'Traceback' not in err
    stamps = [msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec for msg in images]
    assert before < stamps[0] <= stamps[-1] < time.time()
    assert stamps == sorted(set(stamps))


@pytest.mark.parametrize(
    ('arguments', 'code', 'says'),
    [
        (['--remap', '/image'], 2, 'must be FROM:=TO'),
        (['--remap', '/image:=/b c'], 2, 'must be FROM:=TO'),
        (['--remap', '/gone:=/x'], 2, '/gone is not played; played are '),
        (['--remap', '/image:=/camera_info'], 2, 'would become one'),
        (['--rate', '0'], 2, '--rate'),
        (['--topic', '/image'], 2, 'give both or none'),
        (['--topic', '/camera_info', '--rate', '5'], 1, 'must be sensor_msgs/msg/Image'),
    ],
)
def test_wrong_usage_is_told_before_anything_is_played(
    ros_environment, bag, capsys, arguments, code, says
):
    from rsmb_ros.cli.main import main

    try:
        found = main(['play', str(bag), *arguments])
    except SystemExit as error:  # argparse
        found = error.code
    assert found == code
    assert says in capsys.readouterr().err


def test_bag_without_images_is_bad_data(ros_environment, tmp_path, capsys):
    from rsmb_ros.cli.main import main

    path = tmp_path / 'text.mcap'
    with BagWriter(path) as writer:
        writer.write('/talk', BagFactory().text('hello'), 1)
    assert main(['play', str(path)]) == 1
    assert 'there is no image to play' in capsys.readouterr().err


@pytest.mark.parametrize('stamp_ns', [0, 1, 1_700_000_000_123_456_789])
@pytest.mark.parametrize('little', [True, False])
def test_stamp_is_replaced_where_it_lies(ros_environment, stamp_ns, little):
    """Against rosbags' own serialiser, which writes either byte order."""
    from rosbags.typesys import Stores, get_typestore

    from rsmb_ros.ros.player import restamped, stamp_of

    store = get_typestore(Stores.ROS2_JAZZY)
    factory = BagFactory()
    kind = 'sensor_msgs/msg/CompressedImage'
    png = cv2.imencode('.png', np.eye(4, dtype=np.uint8))[1].tobytes()

    def data(stamp):
        message = factory.compressed(factory.header(stamp, 'cam'), png, 'png')
        return bytes(store.serialize_cdr(message, kind, little_endian=little))

    assert stamp_of(data(5)) == 5
    assert restamped(data(5), stamp_ns) == data(stamp_ns)
    assert stamp_of(data(stamp_ns)) == stamp_ns
