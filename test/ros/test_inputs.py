"""The real node takes every kind of image it promises, and nothing that would hurt it."""

import itertools
import json
import struct
import zlib
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from rsmb_ros.messages.images import KNOWN_ENCODINGS

READY_S, ANSWER_S = 240.0, 30.0
STAMP_NS = 1_700_000_300_000_000_000
OK, WARN, ERROR, STALE = range(4)


def count(state, key):
    return int(state.get(key, 0))


@pytest.fixture(scope='module')
def rig(start_node, start_peer, scene):
    """Start node and peer; the node has its reference."""
    node = start_node()
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['regions_json'])
    peer.give_reference(scene.reference)
    return SimpleNamespace(node=node, peer=peer, stamps=itertools.count(STAMP_NS))


def stored_as(encoding, grey, is_bigendian):
    """Return the rows that an Image of `encoding` holds for a grey picture, padded by 2 bytes."""
    rows, cols = grey.shape
    if encoding == 'nv12':
        stored = np.vstack([grey, np.full((rows // 2, cols), 128, np.uint8)])
    elif encoding in ('yuv422_yuy2', 'yuv422'):
        luma_first = encoding == 'yuv422_yuy2'
        chroma = np.full_like(grey, 128)
        stored = np.dstack([grey, chroma] if luma_first else [chroma, grey])
    elif encoding.endswith('16') or encoding == '16UC1':
        stored = (grey.astype(np.uint16) * 257).astype('>u2' if is_bigendian else '<u2')
    else:
        channels = {'8UC3': 3, 'bgr8': 3, 'rgb8': 3, 'bgra8': 4, 'rgba8': 4}.get(encoding, 1)
        stored = np.dstack([grey] * channels)
    stored = np.ascontiguousarray(stored)
    as_bytes = stored.view(np.uint8).reshape(stored.shape[0], -1)
    return np.pad(as_bytes, ((0, 0), (0, 2)), constant_values=201)


@pytest.mark.parametrize('is_bigendian', [0, 1])
@pytest.mark.parametrize('encoding', KNOWN_ENCODINGS)
def test_every_encoding_padded_and_of_either_endianness_registers(
    rig, scene, encoding, is_bigendian
):
    stamp_ns = next(rig.stamps)
    stored = stored_as(encoding, scene.unchanged, is_bigendian)
    msg = rig.peer.message(stored, stamp_ns)
    msg.height, msg.width = scene.shape
    msg.encoding, msg.is_bigendian, msg.step = encoding, is_bigendian, stored.shape[1]
    results = rig.peer.results_of(lambda: rig.peer.image.publish(msg), stamp_ns)
    found = json.loads(results['regions_json'].data)
    assert found['status'] == 'registered', found['reason']
    assert not found['regions']


def test_camera_info_with_distortion_is_told_once(rig):
    from sensor_msgs.msg import CameraInfo

    msg = CameraInfo(d=[-0.2, 0.05, 0.0, 0.0, 0.0], distortion_model='plumb_bob', width=160)
    msg.k[0] = 300.0

    def told():
        return [line for line in rig.node.log if 'lens distortion' in line]

    rig.peer.wait_until(told, ANSWER_S, 'word', repeat=lambda: rig.peer.camera_info.publish(msg))
    sent = itertools.count(1)
    rig.peer.wait_until(
        lambda: next(sent) > 20,
        ANSWER_S,
        'twenty more',
        repeat=lambda: rig.peer.camera_info.publish(msg),
    )
    assert len(told()) == 1


def test_image_above_the_limit_is_refused_until_the_limit_is_raised(rig, scene):
    rig.peer.set_parameter('worker.max_megapixels', 0.015)
    before = rig.peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')

    def send():
        rig.peer.image.publish(rig.peer.message(scene.live, next(rig.stamps)))

    try:
        rig.peer.wait_for_state(
            lambda state: count(state, 'malformed: too large') > 0,
            ANSWER_S,
            'image refused',
            repeat=send,
        )
        rig.node.wait_for_log(
            r'120 rows x 160 columns: 0\.0 Mpx, worker\.max_megapixels = 0\.015', ANSWER_S
        )
    finally:
        rig.peer.set_parameter('worker.max_megapixels', 50.0)
    rig.peer.wait_for_state(
        lambda state: count(state, 'frames processed') > count(before, 'frames processed'),
        ANSWER_S,
        'image taken',
        repeat=send,
    )


# -- compressed ------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def compressed(start_node, start_peer, scene):
    """Start a node for compressed images in a namespace, and a peer that gave it a reference."""
    from sensor_msgs.msg import CompressedImage

    node = start_node(['-r', '__ns:=/jpg', '-p', 'image_transport:=compressed'])
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['regions_json'], namespace='/jpg')
    reference = peer.node.create_publisher(CompressedImage, 'reference/image/compressed', 1)

    def message(data, text, stamp_ns=0):
        msg = CompressedImage(format=text, data=data)
        msg.header = peer.message(np.zeros((1, 1), np.uint8), stamp_ns).header
        return msg

    msg = message(cv2.imencode('.png', scene.reference)[1].tobytes(), 'png')
    peer.wait_for_state(
        lambda state: state['reference'] == 'present',
        ANSWER_S,
        'reference',
        repeat=lambda: reference.publish(msg),
    )
    return SimpleNamespace(node=node, peer=peer, message=message, stamps=itertools.count(STAMP_NS))


@pytest.mark.parametrize(
    ('suffix', 'text'),
    [
        ('.jpg', 'jpeg'),
        ('.jpg', 'jpg'),
        ('.jpg', 'bgr8; jpeg compressed bgr8'),
        ('.jpg', 'mono8; jpeg compressed '),
        ('.png', 'png'),
        ('.png', 'bgr8; png compressed bgr8'),
        ('.png', ''),
    ],
)
def test_compressed_image_of_any_format_string_registers(compressed, scene, suffix, text):
    stamp_ns = next(compressed.stamps)
    picture = scene.unchanged
    if 'bgr8' in text:
        picture = np.dstack([picture] * 3)
    msg = compressed.message(cv2.imencode(suffix, picture)[1].tobytes(), text, stamp_ns)
    results = compressed.peer.results_of(lambda: compressed.peer.compressed.publish(msg), stamp_ns)
    assert json.loads(results['regions_json'].data)['status'] == 'registered'


def png_bomb(rows, cols):
    """Return a small valid PNG of a great many equal pixels."""

    def chunk(name, data):
        body = name + data
        return struct.pack('>I', len(data)) + body + struct.pack('>I', zlib.crc32(body))

    packer = zlib.compressobj(9)
    row = bytes(1 + cols)
    data = b''.join(packer.compress(row) for _ in range(rows)) + packer.flush()
    head = struct.pack('>IIBBBBB', cols, rows, 8, 0, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', head) + chunk(b'IDAT', data) + chunk(b'IEND', b'')


def lying_jpeg():
    """Return a JPEG whose header claims 65535 x 65535 pixels."""
    data = bytearray(cv2.imencode('.jpg', np.zeros((32, 32), np.uint8))[1].tobytes())
    at = data.index(b'\xff\xc0')
    data[at + 5 : at + 9] = b'\xff' * 4
    return bytes(data)


def memory_mb(node):
    """Return the largest memory the node's process ever had [MB]."""
    with open(f'/proc/{node.process.pid}/status') as status:
        (line,) = (line for line in status if line.startswith('VmHWM'))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize(
    ('data', 'cause'),
    [
        (png_bomb(15000, 15000), 'too large'),
        (lying_jpeg(), 'too large'),
        (b'BM' + bytes(60), 'undecodable'),
        (cv2.imencode('.png', np.zeros((64, 64), np.uint8))[1].tobytes()[:60], 'short data'),
    ],
    ids=['bomb', 'lying header', 'neither JPEG nor PNG', 'cut off'],
)
def test_hostile_file_is_refused_without_the_memory_it_asks_for(compressed, data, cause):
    peer = compressed.peer
    before = peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    memory = memory_mb(compressed.node)
    key = f'malformed: {cause}'
    state = peer.wait_for_state(
        lambda state: count(state, key) > count(before, key),
        ANSWER_S,
        f'growing {key}',
        repeat=lambda: peer.compressed.publish(
            compressed.message(data, 'png', next(compressed.stamps))
        ),
    )
    assert state['level'] == WARN
    assert memory_mb(compressed.node) - memory < 50  # MB; the bomb asks for 225, the lie for 4300


def test_file_that_only_the_decoder_can_tell_is_bad_is_counted_too(compressed):
    data = bytearray(cv2.imencode('.png', np.zeros((64, 64), np.uint8))[1].tobytes())
    at = data.index(b'IDAT')
    data[at + 4 : at + 12] = b'\x00' * 8
    peer = compressed.peer
    before = peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    state = peer.wait_for_state(
        lambda state: (
            count(state, 'malformed: undecodable') > count(before, 'malformed: undecodable')
        ),
        ANSWER_S,
        'undecodable file',
        repeat=lambda: peer.compressed.publish(
            compressed.message(bytes(data), 'png', next(compressed.stamps))
        ),
    )
    assert count(state, 'dropped: malformed') > count(before, 'dropped: malformed')
