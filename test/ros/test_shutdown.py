"""The node ends with 0 on every signal, whatever it is doing."""

import signal
import time

import pytest

from rsmb_ros.ros.main import STOP_DEADLINE_S

READY_S, END_S = 60.0, 30.0
RUNS, AT_ONCE = 10, 5
REQUESTS = {
    'SIGINT': [signal.SIGINT],
    'SIGTERM': [signal.SIGTERM],
    'repeated': [signal.SIGINT, signal.SIGINT, signal.SIGTERM, signal.SIGINT],
}


def end(node, numbers):
    """Send the signals, return exit code and log."""
    for number in numbers:
        node.send(number)
    return node.wait(END_S), node.log


@pytest.mark.parametrize('numbers', REQUESTS.values(), ids=REQUESTS)
def test_signal_ends_the_node_with_0_every_time(start_node, numbers):
    for _ in range(RUNS // AT_ONCE):
        nodes = [start_node() for _ in range(AT_ONCE)]
        for node in nodes:
            node.wait_for_log('ready: ', READY_S)
        ended = [end(node, numbers) for node in nodes]
        assert [code for code, _ in ended] == [0] * AT_ONCE, ended
        assert not any('Traceback' in line for _, log in ended for line in log), ended


@pytest.mark.parametrize('numbers', REQUESTS.values(), ids=REQUESTS)
def test_signal_while_frames_flow_ends_the_node_with_0(start_node, start_peer, scene, numbers):
    node, peer = start_node(), start_peer()
    node.wait_for_log('ready: ', READY_S)
    peer.give_reference(scene.reference)
    msg = peer.message(scene.live, stamp_ns=1)
    peer.results_of(lambda: peer.image.publish(msg), 1)
    for _ in range(20):
        peer.image.publish(msg)
    code, log = end(node, numbers)
    assert code == 0, log
    assert not any('Traceback' in line or 'ERROR' in line for line in log), log


def test_signal_before_the_node_is_up_ends_it_with_0(start_node):
    node = start_node(PYTHONVERBOSE='1')  # logs every import: tells how far it has come
    node.wait_for_log('rclpy/__init__', READY_S)
    code, log = end(node, [signal.SIGINT])
    assert code == 0, log[-20:]


def test_signal_while_kernels_compile_ends_the_node_with_0_in_time(start_node, tmp_path):
    node = start_node(NUMBA_CACHE_DIR=str(tmp_path))  # empty: nothing is compiled yet
    node.wait_for_log('compiling kernels', READY_S)
    begin = time.monotonic()
    code, log = end(node, [signal.SIGINT])
    took = time.monotonic() - begin
    assert code == 0, log
    assert took < STOP_DEADLINE_S + 3.0  # s, for taking down the rest on a busy machine
    assert not any('kernels compiled' in line for line in log), 'compiled before the signal came'
