"""Clients that are not ours publish the input and receive the outputs, byte for byte."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CLIENT = Path(__file__).with_name('foreign_client.py')
READY_S, RUN_S, ANSWER_S = 240.0, 150.0, 30.0


@pytest.fixture(scope='module')
def rig(start_node, start_peer):
    """Start a node and a peer of ours that hears the same outputs."""
    start_node().wait_for_log('ready: ', READY_S)
    peer = start_peer()
    # diagnostics were subscribed to last: once they come, the node knows our other subscriptions
    peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    return peer


@pytest.mark.parametrize('client', ['rosless', 'cyclonedds'])
def test_foreign_client_is_heard_and_receives_what_we_receive(rig, scene, client, tmp_path):
    if importlib.util.find_spec(client) is None:
        pytest.skip(f'{client} is not installed: pip install rsmb_ros[interop]')
    given, received = tmp_path / 'given.npz', tmp_path / 'received.npz'
    np.savez(given, reference=scene.reference, live=scene.live)
    for messages in rig.outputs.values():
        messages.clear()
    process = subprocess.Popen(
        [sys.executable, str(CLIENT), client, str(given), str(received)],
        env=os.environ,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        try:
            rig.wait_until(lambda: process.poll() is not None, RUN_S, f'end of {client}')
        finally:
            process.kill()
        said = process.stderr.read()
    assert process.returncode == 0, said
    with np.load(received) as foreign:
        sec = int(foreign['sec'])
        ours = ours_of(rig, sec)
        for name, msg in ours.items():
            expected = msg.data.encode() if name == 'regions_json' else bytes(msg.data)
            assert foreign[name].tobytes() == expected, name
            if name != 'regions_json':
                about = [msg.header.frame_id, msg.encoding, msg.height, msg.width, msg.step]
                assert json.loads(str(foreign[f'{name} about'])) == about
                assert msg.header.frame_id == 'foreign'
        assert json.loads(ours['regions_json'].data)['status'] == 'registered'
        assert np.count_nonzero(foreign['change_mask']) > 200  # the object of 24 x 28 px


def ours_of(rig, sec):
    """Return our own outputs of the frame, once they are complete."""

    def second(msg):
        return (
            msg.header.stamp.sec if hasattr(msg, 'header') else json.loads(msg.data)['stamp']['sec']
        )

    def found():
        return {
            name: msg
            for name, messages in rig.outputs.items()
            if name != 'row_motion'
            for msg in messages
            if second(msg) == sec
        }

    rig.wait_until(lambda: len(found()) == len(rig.outputs) - 1, ANSWER_S, f'outputs of {sec} s')
    return found()
