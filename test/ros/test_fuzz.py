"""
The real node under generated messages on all its inputs: it goes on, and its memory is bounded.

``RSMB_FUZZ=700 pytest test/ros/test_fuzz.py`` sends 700 messages of each kind to each topic.
"""

import itertools
from array import array
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('hypothesis', reason='pip install rsmb_ros[test]')

import cv2
from fuzzing import camera_infos, compressed, images, thorough
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

READY_S, ANSWER_S = 240.0, 60.0
STAMP_NS = 1_700_000_500_000_000_000
EXAMPLES = 250  # of four messages, twice: 2,000
AT_ONCE = 20  # messages sent before the node is asked how far it is
ROOM_MB = 200  # the detector of another size, and what DDS keeps


@pytest.fixture(scope='module', params=['raw', 'compressed'])
def rig(request, start_node, start_peer, scene):
    """Start a node that loses no message, and a peer that gave it a reference."""
    from sensor_msgs.msg import CompressedImage, Image

    transport = request.param
    kind = CompressedImage if transport == 'compressed' else Image
    suffix = '/compressed' if transport == 'compressed' else ''
    space = f'/fuzz_{transport}'
    arguments = ['-r', f'__ns:={space}', '-p', f'image_transport:={transport}']
    for topic in (f'{space}/image{suffix}', f'{space}/reference/image{suffix}'):
        for policy in ('reliability:=reliable', 'history:=keep_all', 'depth:=1000'):
            arguments += ['-p', f'qos_overrides.{topic}.subscription.{policy}']
    node = start_node(arguments)
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['change_mask'], namespace=space)
    rig = SimpleNamespace(
        node=node,
        peer=peer,
        scene=scene,
        sent=0,
        stamps=itertools.count(STAMP_NS),
        compressed=suffix != '',
        image=peer.node.create_publisher(kind, f'image{suffix}', 1000),
        reference=peer.node.create_publisher(kind, f'reference/image{suffix}', 1000),
    )
    prove_alive(rig)
    return rig


def good(rig, picture, stamp_ns=0):
    """Return a message of the kind the node takes."""
    from sensor_msgs.msg import CompressedImage

    msg = rig.peer.message(picture, stamp_ns)
    if not rig.compressed:
        return msg
    data = cv2.imencode('.png', picture)[1].tobytes()
    return CompressedImage(header=msg.header, format='png', data=data)


def prove_alive(rig):
    """Give a good reference and have a good frame answered."""
    stamp_ns = next(rig.stamps)
    reference, live = good(rig, rig.scene.reference), good(rig, rig.scene.live, stamp_ns)

    def send():
        rig.reference.publish(reference)
        rig.image.publish(live)

    rig.peer.results_of(send, stamp_ns)
    assert rig.node.process.poll() is None


def memory_mb(rig):
    with open(f'/proc/{rig.node.process.pid}/status') as status:
        (line,) = (line for line in status if line.startswith('VmHWM'))
    return int(line.split()[1]) / 1024


def message(kind, fields):
    """Return a message of rclpy with the generated fields."""
    msg = kind()
    msg.header.stamp.sec, msg.header.stamp.nanosec = fields.pop('stamp')
    if 'roi_width' in fields:
        msg.roi.width = fields.pop('roi_width')
        fields['k'] = np.array(fields['k'])
    if 'data' in fields:
        fields['data'] = array('B', fields['data'])
    for name, value in fields.items():
        setattr(msg, name, value)
    return msg


def test_generated_messages_on_every_input_leave_the_node_working(rig):
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image

    kind, fields = (CompressedImage, compressed()) if rig.compressed else (Image, images())
    before = rig.peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    memory = memory_mb(rig)
    sent = itertools.count(1)

    def received():
        return int(rig.peer.state()['frames received']) - int(before['frames received'])

    @given(fields, fields, images(st.sampled_from(['32FC1', '16UC1', 'x'])), camera_infos())
    @settings(thorough(EXAMPLES), phases=[Phase.generate])  # what failed once is not sent again
    def send(live, reference, depth, info):
        rig.image.publish(message(kind, live))
        rig.reference.publish(message(kind, reference))
        rig.peer.depth.publish(message(Image, depth))
        rig.peer.camera_info.publish(message(CameraInfo, info))
        rig.sent = next(sent)
        if rig.sent % AT_ONCE == 0:
            rig.peer.wait_for_state(
                lambda _: received() >= rig.sent, ANSWER_S, f'{rig.sent} messages received'
            )

    send()
    state = rig.peer.wait_for_state(
        lambda state: received() == rig.sent and state['worker'] == 'idle',
        ANSWER_S,
        f'all {rig.sent} messages received, and an idle worker',
    )
    assert int(state['malformed messages']) > 0
    prove_alive(rig)
    state = rig.peer.wait_for_state(
        lambda state: state['frames waiting'] == '0', ANSWER_S, 'idle node'
    )
    assert 'dropped: exception' not in state, [line for line in rig.node.log if 'ERROR' in line]
    assert int(state['frames received']) == (
        int(state['frames processed']) + int(state['frames dropped'])
    )
    assert memory_mb(rig) - memory < ROOM_MB
