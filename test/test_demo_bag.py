"""The demo bag through the real node, the replay and `rsmb detect`: one code path, equal bits."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from rsmb_ros.cli.main import main

BAG = Path(__file__).parents[1] / 'bags' / 'demo.mcap'
DEMO_S = 240.0  # deadline of the demo: 20 frames at 0.5 Hz and a cold start
FRAMES = 20
PRESENT = {'object 1': 15, 'object 2': 10}  # frames that hold them


@pytest.fixture(scope='module')
def outputs(tmp_path_factory):
    """Folder with what the demo (real node) and the replay wrote, and the demo's table."""
    pytest.importorskip('rclpy', reason='the real node needs rclpy')
    folder = tmp_path_factory.mktemp('demo')
    demo = subprocess.run(
        [sys.executable, '-m', 'rsmb_ros.cli.main', 'demo', '--bag', BAG, '-o', folder],
        capture_output=True,
        text=True,
        timeout=DEMO_S,
        check=False,
    )
    assert demo.returncode == 0, demo.stderr
    assert main(['replay', str(BAG), '-o', str(folder / 'replay.mcap')]) == 0
    return folder, demo.stdout


def images(bag: Path, topic: str) -> dict[int, np.ndarray]:
    """Arrays of an Image topic by stamp [ns]; mono8 and bgr8 only."""
    found = {}
    with AnyReader([bag]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == topic]
        assert chosen, f'{bag} has {sorted(reader.topics)}'
        for connection, _, raw in reader.messages(chosen):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            channels = {'mono8': (), 'bgr8': (3,)}[message.encoding]
            found[stamp] = message.data.reshape(message.height, message.width, *channels)
    return found


def test_demo_finds_both_objects_and_nothing_else(outputs):
    _, table = outputs
    processed = int(re.search(r'frames processed: (\d+)', table).group(1))
    assert processed >= FRAMES // 2, table  # a busy machine may drop some of the 20: newest wins
    for name, frames in PRESENT.items():
        row = re.search(rf'{name}\s+(\d+)\s+(\d+)', table)
        assert row, table
        present, found = (int(value) for value in row.groups())
        assert frames - (FRAMES - processed) <= present <= frames, table
        assert found == present, table
    assert re.search(r'false alarms\): 0\b', table), table


@pytest.mark.parametrize('name', ['change_mask', 'valid_mask', 'registered', 'rectified'])
def test_node_and_replay_publish_equal_pictures(outputs, name):
    folder, _ = outputs
    node, replay = (images(folder / bag, f'/rsmb/{name}') for bag in ('demo.mcap', 'replay.mcap'))
    assert len(replay) == FRAMES
    assert len(node) >= FRAMES // 2
    assert set(node) <= set(replay)
    for stamp, picture in node.items():
        np.testing.assert_array_equal(picture, replay[stamp])


@pytest.mark.parametrize('index', [3, 16])
def test_detect_gives_the_masks_of_the_replay(outputs, index, tmp_path):
    folder, _ = outputs
    files = {}
    with AnyReader([BAG]) as reader:
        for connection, _, raw in reader.messages():
            if connection.msgtype == 'sensor_msgs/msg/CompressedImage':
                message = reader.deserialize(raw, connection.msgtype)
                files.setdefault(connection.topic, []).append(message.data.tobytes())
    reference, live = tmp_path / 'reference.jpg', tmp_path / 'live.jpg'
    reference.write_bytes(files['/reference/image/compressed'][0])
    live.write_bytes(files['/image/compressed'][index])
    assert main(['detect', str(reference), str(live), '-o', str(tmp_path)]) == 0
    for name in ('change_mask', 'valid_mask'):
        replayed = images(folder / 'replay.mcap', f'/rsmb/{name}')
        expected = replayed[sorted(replayed)[index]]
        found = cv2.imread(str(tmp_path / f'{name}.png'), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(found, expected)
    result = json.loads((tmp_path / 'result.json').read_text())
    changes = [region for region in result['regions'] if region['kind'] == 'change']
    assert len(changes) == {3: 0, 16: 2}[index]
    assert abs(result['exposure_rows'] / 50.0 - 1) < 0.02
