"""The real node among others: names, QoS, services, simulated time, parameters from outside."""

import itertools
import json
from types import SimpleNamespace

import numpy as np
import pytest

READY_S, ANSWER_S = 240.0, 30.0
STAMP_NS = 1_700_000_400_000_000_000


@pytest.fixture(scope='module')
def pair(start_node, start_peer, scene):
    """Start two nodes on this host, in namespaces, each with a peer; the second one remapped."""
    nodes = [
        start_node(
            [
                *['-r', '__ns:=/left', '-p', 'qos_overrides./left/image.subscription.depth:=3'],
                *['-p', 'qos_overrides./left/image.subscription.reliability:=reliable'],
                '-p',
                'qos_overrides./left/rsmb/change_mask.publisher.reliability:=best_effort',
            ]
        ),
        start_node(['-r', '__ns:=/right', '-r', 'image:=cam/image_rect']),
    ]
    for node in nodes:
        node.wait_for_log('ready: ', READY_S)
    peers = [start_peer(['regions_json'], name) for name in ('/left', '/right')]
    return SimpleNamespace(nodes=nodes, peers=peers, stamps=itertools.count(STAMP_NS))


def live_publisher(peer, topic):
    from sensor_msgs.msg import Image

    return peer.node.create_publisher(Image, topic, 1)


def test_two_nodes_on_one_host_answer_each_its_own_input(pair, scene):
    """The left one has the reference, the right one its mirror image."""
    mirrored = np.ascontiguousarray(scene.reference[:, ::-1])
    for peer, reference in zip(pair.peers, (scene.reference, mirrored), strict=True):
        peer.give_reference(reference)
    topics = ('image', 'cam/image_rect')
    for peer, topic, status in zip(
        pair.peers, topics, ('registered', 'not_registered'), strict=True
    ):
        stamp_ns = next(pair.stamps)
        msg = peer.message(scene.unchanged, stamp_ns)
        publisher = live_publisher(peer, topic)
        results = peer.results_of(lambda p=publisher, m=msg: p.publish(m), stamp_ns)
        assert json.loads(results['regions_json'].data)['status'] == status


def test_rectified_images_are_warned_of_once(pair):
    def told(node):
        return [line for line in node.log if 'rectified by its name' in line]

    assert [len(told(node)) for node in pair.nodes] == [0, 1]
    assert '/right/cam/image_rect' in told(pair.nodes[1])[0]


def test_qos_is_as_overridden_and_as_promised_elsewhere(pair):
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    node = pair.peers[0].node

    def endpoint(infos, topic):
        """Return what is known of the only endpoint, which is discovered in its own time."""
        pair.peers[0].wait_until(lambda: infos(topic), ANSWER_S, f'an endpoint at {topic}')
        (own,) = infos(topic)
        return own.qos_profile.reliability

    subscribed, published = node.get_subscriptions_info_by_topic, node.get_publishers_info_by_topic
    assert endpoint(subscribed, '/left/image') == ReliabilityPolicy.RELIABLE
    assert endpoint(published, '/left/rsmb/change_mask') == ReliabilityPolicy.BEST_EFFORT
    assert endpoint(subscribed, '/right/cam/image_rect') == ReliabilityPolicy.BEST_EFFORT
    assert endpoint(published, '/right/rsmb/change_mask') == ReliabilityPolicy.RELIABLE
    durabilities = {
        info.qos_profile.durability
        for info in node.get_subscriptions_info_by_topic('/right/reference/image')
    }
    assert durabilities == {DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE}


def test_parameters_are_described_to_tools(pair):
    from rcl_interfaces.srv import DescribeParameters

    names = ['worker.deadline_s', 'worker.threads', 'autostart']
    request = DescribeParameters.Request(names=names)
    answer = pair.peers[0].call(DescribeParameters, '/left/rsmb/describe_parameters', request)
    deadline, threads, _ = answer.descriptors
    (bounds,) = deadline.floating_point_range
    assert (bounds.from_value, bounds.to_value) == (0.001, 3600.0)
    assert 'takes longer is reported' in deadline.description
    (limits,) = threads.integer_range
    assert (limits.from_value, limits.to_value) == (1, 64)
    assert [d.read_only for d in answer.descriptors] == [False, False, True]


def ask_left(pair, image):
    """Return what the left node says of a frame."""
    peer, stamp_ns = pair.peers[0], next(pair.stamps)
    msg = peer.message(image, stamp_ns)
    results = peer.results_of(lambda: peer.image.publish(msg), stamp_ns)
    return json.loads(results['regions_json'].data)


def test_next_frame_becomes_the_reference_when_asked(pair, scene):
    from std_srvs.srv import Trigger

    peer = pair.peers[0]
    before = peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    answer = peer.call(Trigger, '/left/rsmb/set_reference', Trigger.Request())
    assert answer.success
    assert answer.message == 'the next frame on /left/image becomes the reference'
    mirrored = np.ascontiguousarray(scene.unchanged[:, ::-1])
    state = peer.wait_for_state(
        lambda state: state['references received'] > before['references received'],
        ANSWER_S,
        'new reference',
        repeat=lambda: peer.image.publish(peer.message(mirrored, next(pair.stamps))),
    )
    assert state['dropped: became the reference'] == '1'
    assert ask_left(pair, mirrored)['status'] == 'registered'
    assert ask_left(pair, scene.unchanged)['status'] == 'not_registered'


def test_paused_node_publishes_nothing_until_it_is_enabled(pair, scene):
    from std_srvs.srv import SetBool

    peer = pair.peers[0]
    answer = peer.call(SetBool, '/left/rsmb/enable', SetBool.Request(data=False))
    assert (answer.success, answer.message) == (True, 'paused')
    peer.outputs['regions_json'].clear()
    state = peer.wait_for_state(
        lambda state: int(state.get('dropped: paused', 0)) > 2,
        ANSWER_S,
        'frames dropped by the pause',
        repeat=lambda: peer.image.publish(peer.message(scene.unchanged, next(pair.stamps))),
    )
    assert (state['message'], state['paused']) == ('paused by ~/enable', 'true')
    assert not peer.outputs['regions_json']
    assert peer.call(SetBool, '/left/rsmb/enable', SetBool.Request(data=True)).message == 'enabled'
    assert ask_left(pair, scene.unchanged)


def test_simulated_time_that_stands_still_stops_nothing(start_node, start_peer, scene):
    """Stamps are compared with the bag's time; diagnostics go on while the bag is paused."""
    from rosgraph_msgs.msg import Clock

    node = start_node(['-r', '__ns:=/bag', '-p', 'use_sim_time:=true'])
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['regions_json'], namespace='/bag')
    clock = peer.node.create_publisher(Clock, '/clock', 1)
    time = Clock()
    time.clock.sec = STAMP_NS // 10**9 + 100

    def of_the_bag(state):
        return peer.diagnostics[-1].header.stamp.sec == time.clock.sec

    peer.wait_for_state(of_the_bag, ANSWER_S, 'time', repeat=lambda: clock.publish(time))
    peer.give_reference(scene.reference)
    stamp_ns = (time.clock.sec - 2) * 10**9
    msg = peer.message(scene.unchanged, stamp_ns)
    peer.results_of(lambda: peer.image.publish(msg), stamp_ns)
    state = peer.wait_for_state(
        lambda state: state['latency stamp to published p50 [ms]'], ANSWER_S, 'latency'
    )
    assert float(state['latency stamp to published p50 [ms]']) == 2000.0
    assert 'stamps ahead of the clock' not in state
