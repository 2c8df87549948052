"""The real node in its own process: every topic, good and bad input, parameters at run time."""

import itertools
import json
import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.messages.images import image_from_msg
from rsmb_ros.messages.outputs import OUTPUTS

READY_S, ANSWER_S = 240.0, 30.0
STAMP_NS = 1_700_000_000_123_456_789
OK, WARN, ERROR, STALE = range(4)


@pytest.fixture(scope='module')
def rig(start_node, start_peer, scene):
    """Start node and peer; the node has its reference and has answered once."""
    node = start_node()
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer()
    peer.give_reference(scene.reference)
    rig = SimpleNamespace(node=node, peer=peer, scene=scene, stamps=itertools.count(STAMP_NS))
    ask(rig, scene.unchanged)
    return rig


def ask(rig, image, frame_id='cam', names=None):
    """Return the outputs for `image`; its stamp is like no other, what is repeated comes late."""
    stamp_ns = next(rig.stamps)
    msg = rig.peer.message(image, stamp_ns, frame_id)
    return rig.peer.results_of(lambda: rig.peer.image.publish(msg), stamp_ns, names)


def test_volatile_reference_raises_no_warning_about_the_latched_subscription(rig):
    assert not [line for line in rig.node.log if 'incompatible' in line]


def test_every_output_arrives_with_stamp_and_frame_id_of_the_live_frame(rig):
    results = ask(rig, rig.scene.live, frame_id='cam_down')
    assert results.keys() == {output.name for output in OUTPUTS}
    values = json.loads(results['regions_json'].data)
    stamp = values['stamp']
    assert stamp['sec'] * 10**9 + stamp['nanosec'] == next(rig.stamps) - 1
    assert values['frame_id'] == 'cam_down'
    for output in OUTPUTS:
        if output.type.endswith('/Image'):
            header = results[output.name].header
            assert {'sec': header.stamp.sec, 'nanosec': header.stamp.nanosec} == stamp
            assert header.frame_id == 'cam_down'


def test_outputs_have_the_encodings_and_shapes_of_the_contract(rig):
    results = ask(rig, rig.scene.live)
    encodings = {
        'registered': 'mono8',
        'rectified': 'mono8',
        'change_mask': 'mono8',
        'valid_mask': 'mono8',
        'residual': '32FC1',
        'overlay': 'bgr8',
    }
    for name, encoding in encodings.items():
        msg = results[name]
        assert (name, msg.encoding) == (name, encoding)
        assert (msg.height, msg.width) == rig.scene.shape
        assert len(msg.data) == msg.height * msg.step
    dimensions = results['row_motion'].layout.dim
    assert [(d.label, d.size) for d in dimensions] == [
        ('row', rig.scene.shape[0]),
        ('component', 6),
    ]
    assert len(results['row_motion'].data) == rig.scene.shape[0] * 6


def test_object_that_appeared_is_published_as_changed(rig):
    results = ask(rig, rig.scene.live)
    truth = np.zeros(rig.scene.shape, bool)
    truth[rig.scene.box] = True
    found = image_from_msg(results['change_mask']) == 255
    assert (found & truth).sum() / (found | truth).sum() > 0.6
    (region,) = json.loads(results['regions_json'].data)['regions']
    assert region['kind'] == 'change'
    motion = np.array(results['row_motion'].data).reshape(-1, 6)
    # The live frame lies 5 px further right in the reference's plane.
    assert np.abs(np.abs(motion[:, 0]) - 5).max() < 1


def test_frame_in_which_nothing_changed_has_an_empty_mask(rig):
    results = ask(rig, rig.scene.unchanged, names=['change_mask', 'valid_mask'])
    assert not image_from_msg(results['change_mask']).any()
    assert (image_from_msg(results['valid_mask']) == 255).mean() > 0.8


def test_frame_that_cannot_be_registered_is_a_result(rig):
    flat = np.full(rig.scene.shape, 90, np.uint8)
    results = ask(rig, flat)
    values = json.loads(results['regions_json'].data)
    assert values['status'] == 'not_registered'
    assert 'texture' in values['reason']
    assert not image_from_msg(results['valid_mask']).any()
    assert np.isnan(results['row_motion'].data).all()
    state = rig.peer.wait_for_state(
        lambda state: state['status'] == 'not_registered', ANSWER_S, 'state not_registered'
    )
    assert state['level'] == WARN
    assert values['reason'] in state['message']


def test_diagnostics_of_a_healthy_node_name_rates_latency_and_counts(rig):
    def send():
        now_ns = rig.peer.node.get_clock().now().nanoseconds
        rig.peer.image.publish(rig.peer.message(rig.scene.live, now_ns))

    state = rig.peer.wait_for_state(
        lambda state: state['level'] == OK and float(state['input rate [Hz]']) > 1,
        ANSWER_S,
        'healthy state',
        repeat=send,
    )
    assert state['message'] == 'registered'
    assert float(state['output rate [Hz]']) > 0
    p50, p95 = (float(state[f'latency arrival to published p{p} [ms]']) for p in (50, 95))
    assert 0 < p50 <= p95
    assert float(state['latency stamp to published p95 [ms]']) > 0
    assert state['reference'] == 'present'
    assert state['worker alive'] == 'true'
    assert int(state['frames processed']) > 0
    assert float(state['residual mean [grey levels]']) > 0
    assert 0 < float(state['judged [%]']) <= 100
    assert float(state['exposure [rows]']) >= 0
    assert float(state['reference age [s]']) > 0
    assert state['lifecycle state'] == 'active'
    assert state['worker'] in ('idle', 'busy')
    received, processed, dropped, waiting = (
        int(state[f'frames {what}']) for what in ('received', 'processed', 'dropped', 'waiting')
    )
    assert received == processed + dropped + waiting
    by_cause = [int(n) for key, n in state.items() if key.startswith('dropped: ')]
    assert sum(by_cause) == dropped


def test_silence_is_stale(rig):
    state = rig.peer.wait_for_state(lambda state: state['level'] == STALE, ANSWER_S, 'state STALE')
    assert 'no live frame for' in state['message']


def malformed(peer, image):
    """Return messages that contradict themselves, with the cause each is counted under."""

    def changed(**fields):
        msg = peer.message(image, STAMP_NS)
        for name, value in fields.items():
            setattr(msg, name, value)
        return msg

    impossible = peer.message(image)
    impossible.header.stamp.nanosec = 4_000_000_000
    return {
        'short data': [changed(height=60000, width=160), changed(data=b'')],
        'size': [changed(height=0), changed(width=0)],
        'short step': [changed(step=0), changed(step=159)],
        'encoding': [changed(encoding=''), changed(encoding='mono9')],
        'stamp': [impossible],
    }


@pytest.mark.parametrize('topic', ['image', 'reference'])
def test_malformed_messages_are_counted_by_cause_and_the_node_goes_on(rig, topic):
    messages = malformed(rig.peer, rig.scene.live)
    before = rig.peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')

    def all_grew(state):
        keys = [f'malformed: {cause}' for cause in messages]
        return all(int(state.get(key, 0)) > int(before.get(key, 0)) for key in keys)

    one_by_one = itertools.cycle(itertools.chain.from_iterable(messages.values()))
    publisher = getattr(rig.peer, topic)
    state = rig.peer.wait_for_state(
        all_grew,
        ANSWER_S,
        f'growing counts of {list(messages)}',
        repeat=lambda: publisher.publish(next(one_by_one)),
    )
    assert state['level'] == WARN
    assert 'malformed messages' in state['message']
    assert any(f'{topic} skipped: ' in line for line in rig.node.log)
    assert ask(rig, rig.scene.live).keys() == rig.peer.outputs.keys()


def test_useless_camera_info_is_said_and_ignored(rig):
    from sensor_msgs.msg import CameraInfo

    msg = CameraInfo()  # all zero, as an uncalibrated driver sends it
    rig.peer.wait_until(
        lambda: any('camera_info ignored' in line for line in rig.node.log),
        ANSWER_S,
        'word about camera_info',
        repeat=lambda: rig.peer.camera_info.publish(msg),
    )
    assert ask(rig, rig.scene.live, names=['change_mask'])


def test_depth_of_the_reference_is_used_where_it_is_known(rig):
    """Half of the reference has a depth: what is in the other half is not judged."""
    stamp_ns = next(rig.stamps)
    metres = np.full(rig.scene.shape, 50.0, np.float32)
    metres[:, 80:] = np.nan
    # a reference of its own: with another stamp an equal one would stay what it is
    image = rig.scene.reference.copy()
    image[0, 0] ^= 1

    def give():
        rig.peer.reference.publish(rig.peer.message(image, stamp_ns))
        rig.peer.depth.publish(rig.peer.message(metres, stamp_ns))

    def judged():
        msg = ask(rig, rig.scene.unchanged, names=['valid_mask'])['valid_mask']
        return image_from_msg(msg) > 0

    try:
        rig.peer.wait_until(
            lambda: not judged()[:, 90:].any(), ANSWER_S, 'frame judged by depth', repeat=give
        )
        assert judged()[8:-8, 8:60].mean() > 0.9
    finally:
        rig.peer.give_reference(rig.scene.reference)
    assert judged()[8:-8, 90:-12].mean() > 0.9, 'the depth went with its reference'


def test_reference_of_another_size_replaces_the_old_one(rig):
    crop = rig.scene.reference[:100, :140]
    rig.peer.give_reference(np.repeat(crop[:, :, None], 3, axis=2))
    try:
        results = ask(rig, rig.scene.live)
        assert (results['rectified'].height, results['rectified'].width) == crop.shape
        assert results['registered'].encoding == 'bgr8'
        assert (results['registered'].height, results['registered'].width) == rig.scene.shape
    finally:
        rig.peer.give_reference(rig.scene.reference)


@pytest.mark.parametrize(
    ('name', 'value', 'says'),
    [
        ('shutter.exposure_rows', -1.0, 'shutter.exposure_rows = -1.0 .* 0 to 5000 rows'),
        ('shutter.exposure_rows', 'long', "shutter.exposure_rows = 'long' .* 0 to 5000 rows"),
        ('worker.threads', 0, 'worker.threads = 0 .* 1 to 64 threads'),
        ('registration.degrees_of_freedom', 5, 'one of 2, 3, 4, 6'),
        (
            'change.threshold_low',
            9.0,
            'must be below change.threshold_high = ',
        ),
        ('image_transport', 'compressed', 'read-only'),
        ('publish.queue_depth', 7, 'read-only'),
        ('change.treshold_low', 2.0, 'unknown; did you mean change.threshold_low'),
        ('qos_overrides./image.subscription.depth', 3, 'fixed at the start'),
    ],
)
def test_wrong_change_at_run_time_is_refused_with_the_reason(rig, name, value, says):
    answer = rig.peer.set_parameter(name, value)
    assert not answer.successful
    assert re.search(says, answer.reason), answer.reason


@pytest.mark.parametrize('value', [33.0, 34])
def test_change_at_run_time_takes_effect_on_the_next_frame(rig, value):
    assert rig.peer.set_parameter('shutter.exposure_rows', value).successful
    try:
        results = ask(rig, rig.scene.live, names=['regions_json'])
        assert json.loads(results['regions_json'].data)['exposure_rows'] == value
    finally:
        assert rig.peer.set_parameter('shutter.exposure_rows', 0.0).successful


def test_latched_reference_from_before_the_node_is_taken_once(start_node, start_peer, scene):
    peer = start_peer()
    peer.latched_reference.publish(peer.message(scene.reference))
    node = start_node(['-r', '__ns:=/late', '-r', 'reference/image:=/reference/image'])
    node.wait_for_log('ready: .* /reference/image', READY_S)

    def late(state):
        return peer.diagnostics[-1].status[0].name.startswith('late/rsmb') and (
            state['reference'] == 'present'
        )

    peer.wait_for_state(late, ANSWER_S, 'reference present')
    # It reaches the latched and the volatile subscription now.
    peer.latched_reference.publish(peer.message(scene.reference))
    after = peer.node.get_clock().now().nanoseconds + 2 * 10**9
    state = peer.wait_for_state(
        lambda state: late(state) and state_time_ns(peer) > after, ANSWER_S, 'later diagnostics'
    )
    assert state['references received'] == '1'


def state_time_ns(peer):
    stamp = peer.diagnostics[-1].header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def test_compressed_images_are_taken_on_their_topics(start_node, start_peer, scene):
    from sensor_msgs.msg import CompressedImage

    node = start_node(['-p', 'image_transport:=compressed', '-r', '__node:=rsmb'])
    node.wait_for_log('ready: .*reference/image/compressed.* /image/compressed', READY_S)
    peer = start_peer()
    reference = peer.node.create_publisher(CompressedImage, 'reference/image/compressed', 1)

    def compressed(array, stamp_ns):
        msg = CompressedImage(format='mono8; png compressed ')
        msg.header = peer.message(array, stamp_ns).header
        msg.data = cv2.imencode('.png', array)[1].tobytes()
        return msg

    def send():
        reference.publish(compressed(scene.reference, 1))
        peer.compressed.publish(compressed(scene.live, STAMP_NS + 5))

    results = peer.results_of(send, STAMP_NS + 5, names=['change_mask'])
    assert image_from_msg(results['change_mask'])[scene.box].mean() > 200
