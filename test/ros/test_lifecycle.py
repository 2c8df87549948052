"""The real node, managed: each state does what it says and leaves nothing behind."""

from types import SimpleNamespace

import pytest

READY_S, ANSWER_S = 240.0, 30.0
STAMP_NS = 1_700_000_100_000_000_000
INPUTS = {'/image', '/reference/image', '/reference/depth', '/camera_info'}


@pytest.fixture(scope='module')
def rig(start_node, start_peer):
    """Start a node that waits to be managed, and a peer."""
    node = start_node(['-p', 'autostart:=false'])
    node.wait_for_log('waiting to be configured', READY_S)
    return SimpleNamespace(node=node, peer=start_peer(only=['change_mask']))


def change(peer, transition):
    """Ask for a transition, as `ros2 lifecycle set` does; return whether it was done."""
    from lifecycle_msgs.srv import ChangeState

    request = ChangeState.Request()
    request.transition.label = transition
    return peer.call(ChangeState, '/rsmb/change_state', request, READY_S).success


def state(peer):
    """Return the label of the present state."""
    from lifecycle_msgs.srv import GetState

    return peer.call(GetState, '/rsmb/get_state', GetState.Request()).current_state.label


def endpoints(peer):
    """Return topics the node listens to, topics it publishes, and its services, all its own."""
    node = peer.node
    inputs, outputs, services = (
        {name for name, _ in found('rsmb', '/')}
        for found in (
            node.get_subscriber_names_and_types_by_node,
            node.get_publisher_names_and_types_by_node,
            node.get_service_names_and_types_by_node,
        )
    )
    ours = {name for name in outputs if name.startswith('/rsmb/')} - {'/rsmb/transition_event'}
    return inputs & INPUTS, ours, services & {'/rsmb/enable', '/rsmb/set_reference'}


def wait_for_endpoints(peer, inputs, outputs):
    """Wait until the graph shows all inputs or none, and 8 outputs or none."""

    from rclpy.node import NodeNameNonExistentError

    def right():
        try:
            heard, told, _ = endpoints(peer)
        except NodeNameNonExistentError:  # not discovered yet
            return False
        return (heard == INPUTS if inputs else not heard) and (len(told) == 8) == outputs

    peer.wait_until(right, ANSWER_S, f'inputs: {inputs}, outputs: {outputs}')


def test_states_are_gone_through_and_leave_nothing_behind(rig, scene):
    peer = rig.peer
    assert state(peer) == 'unconfigured'
    wait_for_endpoints(peer, inputs=False, outputs=False)
    peer.wait_for_state(
        lambda now: now['message'] == 'not active: unconfigured', ANSWER_S, 'word of the state'
    )

    assert change(peer, 'configure')
    assert any('kernels compiled' in line for line in rig.node.log), 'compiled in configure'
    wait_for_endpoints(peer, inputs=False, outputs=True)

    for turn in range(2):
        assert change(peer, 'activate')
        wait_for_endpoints(peer, inputs=True, outputs=True)
        if turn == 0:
            peer.give_reference(scene.reference)
        # the second time with the reference of the first
        msg = peer.message(scene.live, STAMP_NS + turn)
        peer.results_of(lambda msg=msg: peer.image.publish(msg), STAMP_NS + turn)
        assert change(peer, 'deactivate')
        wait_for_endpoints(peer, inputs=False, outputs=True)

    assert change(peer, 'cleanup')
    wait_for_endpoints(peer, inputs=False, outputs=False)
    assert endpoints(peer)[2] == set()
    now = peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
    assert (now['worker'], now['reference']) == ('none', 'absent')


def test_node_starts_again_after_clean_up_without_its_reference(rig, scene):
    peer = rig.peer
    assert state(peer) == 'unconfigured'
    assert change(peer, 'configure')
    assert change(peer, 'activate')
    msg = peer.message(scene.live, STAMP_NS + 10)
    now = peer.wait_for_state(
        lambda now: int(now.get('dropped: no reference', 0)) > 0,
        ANSWER_S,
        'frame without reference',
        repeat=lambda: peer.image.publish(msg),
    )
    assert now['message'] == 'no reference yet'
    peer.give_reference(scene.reference)
    peer.results_of(lambda: peer.image.publish(msg), STAMP_NS + 10)


def test_wrong_transition_is_refused_and_changes_nothing(rig):
    from lifecycle_msgs.srv import ChangeState

    assert state(rig.peer) == 'active'
    assert not change(rig.peer, 'no_such_transition')
    assert not change(rig.peer, 'cleanup')
    request = ChangeState.Request()
    for number in (1, 77):  # configure, and none at all; rclpy would raise through the executor
        request.transition.id = number
        assert not rig.peer.call(ChangeState, '/rsmb/change_state', request).success
    assert state(rig.peer) == 'active'
    rig.node.wait_for_log('transition .* refused', ANSWER_S)


def test_shutdown_is_for_ever_and_the_process_still_ends_with_0(rig):
    import signal

    assert change(rig.peer, 'shutdown')
    assert state(rig.peer) == 'finalized'
    wait_for_endpoints(rig.peer, inputs=False, outputs=False)
    rig.node.send(signal.SIGTERM)
    assert rig.node.wait(ANSWER_S) == 0, rig.node.log


def test_signal_while_waiting_to_be_configured_ends_the_node_with_0(start_node):
    import signal

    node = start_node(['-p', 'autostart:=false'])
    node.wait_for_log('waiting to be configured', READY_S)
    node.send(signal.SIGINT)
    assert node.wait(ANSWER_S) == 0, node.log
