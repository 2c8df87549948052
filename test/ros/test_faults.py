"""The real node under faults: each has a defined outcome, is reported, and the node goes on."""

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from ros.faulty_node import BROKEN, SLOW, SLOW_S

READY_S, ANSWER_S = 240.0, 30.0
STAMP_NS = 1_700_000_200_000_000_000
FAR_NS = 2_100_000_000_000_000_000  # in the year 2036
OK, WARN, ERROR, STALE = range(4)


@pytest.fixture(scope='module')
def rig(start_node, start_peer, scene):
    """Start the faulty node and a peer; the node has its reference and has answered once."""
    program = [str(Path(__file__).with_name('faulty_node.py'))]
    node = start_node(['-p', 'worker.deadline_s:=1.5'], program=program)
    node.wait_for_log('ready: ', READY_S)
    peer = start_peer(only=['change_mask', 'rectified', 'regions_json'])
    peer.give_reference(scene.reference)
    rig = SimpleNamespace(node=node, peer=peer, scene=scene, stamps=itertools.count(STAMP_NS))
    ask(rig, scene.unchanged)
    return rig


def ask(rig, image, stamp_ns=None):
    """Return the outputs for `image`."""
    stamp_ns = next(rig.stamps) if stamp_ns is None else stamp_ns
    msg = rig.peer.message(image, stamp_ns, 'cam')
    return rig.peer.results_of(lambda: rig.peer.image.publish(msg), stamp_ns)


def marked(image, mark):
    marked = image.copy()
    marked[0, 0] = mark
    return marked


def send_until(rig, image, accept, what):
    """Publish `image`, each time with a new stamp, until the diagnostics are as `accept` says."""
    return rig.peer.wait_for_state(
        accept,
        ANSWER_S,
        what,
        repeat=lambda: rig.peer.image.publish(rig.peer.message(image, next(rig.stamps))),
    )


def count(state, key):
    return int(state.get(key, 0))


def now(rig):
    return rig.peer.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')


def test_exception_is_reported_and_the_next_frame_is_answered(rig):
    broken = marked(rig.scene.live, BROKEN)
    state = send_until(
        rig, broken, lambda s: count(s, 'dropped: exception') > 0, 'frame dropped by exception'
    )
    assert state['level'] == ERROR
    assert state['message'] == 'processing failed: ValueError: a frame that breaks the detector'
    assert any('processing failed: ValueError' in line for line in rig.node.log)
    assert ask(rig, rig.scene.live)
    assert now(rig)['worker alive'] == 'true'


def test_slow_frame_is_told_while_it_is_in_work_and_the_next_is_answered(rig):
    slow = marked(rig.scene.live, SLOW)
    state = send_until(
        rig, slow, lambda s: s['message'].startswith('in work for'), 'word of the frame in work'
    )
    assert state['level'] == ERROR
    assert state['worker'] == 'busy'
    assert float(state['worker busy [s]']) > 1.5
    rig.node.wait_for_log(r'in work for .* s, worker\.deadline_s = 1\.5', ANSWER_S)
    assert ask(rig, rig.scene.live)
    rig.node.wait_for_log(r'a frame took .* s, worker\.deadline_s = 1\.5', ANSWER_S)
    assert count(now(rig), 'frames over deadline') > 0


def test_frame_in_work_is_finished_against_the_reference_it_began_with(rig):
    """Its rectified image has the old reference's size; the next frame's has the new one's."""
    old = rig.scene.reference
    new = np.ascontiguousarray(old[:100, :140])
    stamp_slow, stamp_next = next(rig.stamps), next(rig.stamps)
    rectified = rig.peer.outputs['rectified']
    rectified.clear()
    busy = rig.peer.message(marked(rig.scene.unchanged, SLOW), stamp_slow)
    rig.peer.image.publish(busy)
    rig.peer.wait_for_state(lambda s: s['worker'] == 'busy', ANSWER_S, 'busy worker')
    assert not rectified, f'answered within {SLOW_S} s'
    try:
        rig.peer.reference.publish(rig.peer.message(new))
        later = rig.peer.message(rig.scene.unchanged, stamp_next)
        rig.peer.wait_until(
            lambda: len(rectified) >= 2,
            ANSWER_S,
            'two answers',
            repeat=lambda: rig.peer.image.publish(later) if rectified else None,
        )
        shapes = [(msg.height, msg.width) for msg in rectified[:2]]
        assert shapes == [old.shape, new.shape]
    finally:
        rig.peer.give_reference(old)


def test_size_and_encoding_may_change_from_frame_to_frame(rig):
    live = rig.scene.live
    colour = np.repeat(live[:, :, None], 3, axis=2)
    for image in (live, colour[:100, :140], live[10:110], colour, live):
        results = ask(rig, np.ascontiguousarray(image))
        mask = results['change_mask']
        assert (mask.height, mask.width) == image.shape[:2]
        assert json.loads(results['regions_json'].data)['status'] == 'registered'


def test_frame_too_small_to_register_is_malformed_not_a_failure(rig):
    tiny = np.ascontiguousarray(rig.scene.live[:20, :20])
    before = count(now(rig), 'dropped: malformed')
    state = send_until(
        rig, tiny, lambda s: count(s, 'dropped: malformed') > before, 'tiny frame refused'
    )
    assert state['level'] == WARN
    assert ask(rig, rig.scene.live)


def test_reference_too_small_leaves_none_and_is_told(rig):
    tiny = rig.peer.message(np.ascontiguousarray(rig.scene.reference[:20, :20]))
    try:
        rig.peer.wait_for_state(
            lambda s: s['reference'] == 'absent',
            ANSWER_S,
            'absent reference',
            repeat=lambda: rig.peer.reference.publish(tiny),
        )
        rig.node.wait_for_log('reference refused, there is none now: .*20x20', ANSWER_S)
    finally:
        rig.peer.give_reference(rig.scene.reference)
    assert ask(rig, rig.scene.live)


def test_stamp_is_answered_once(rig):
    stamp_ns = next(rig.stamps)
    ask(rig, rig.scene.live, stamp_ns)
    masks = rig.peer.outputs['change_mask']
    masks.clear()
    again = rig.peer.message(rig.scene.live, stamp_ns)
    before = count(now(rig), 'dropped: repeated stamp')
    state = rig.peer.wait_for_state(
        lambda s: count(s, 'dropped: repeated stamp') > before + 2 and 'odd stamps' in s['message'],
        ANSWER_S,
        'repeated stamps counted',
        repeat=lambda: rig.peer.image.publish(again),
    )
    assert (state['level'], state['message'].split(maxsplit=1)[1]) == (WARN, 'odd stamps: repeated')
    assert not masks
    assert ask(rig, rig.scene.live)


def test_frames_without_stamp_are_all_answered(rig):
    masks = rig.peer.outputs['change_mask']
    masks.clear()
    msg = rig.peer.message(rig.scene.live, stamp_ns=0)
    rig.peer.wait_until(
        lambda: len(masks) >= 3,
        ANSWER_S,
        'three answers',
        repeat=lambda: rig.peer.image.publish(msg),
    )


def test_clock_that_jumps_forth_and_back_stops_nothing(rig):
    """As a camera whose clock is set in flight: every frame is answered, the oddity is told."""
    before = now(rig)
    ask(rig, rig.scene.live, FAR_NS)
    state = now(rig)
    assert count(state, 'stamps ahead of the clock') > count(before, 'stamps ahead of the clock')
    ask(rig, rig.scene.live)  # years earlier
    state = now(rig)
    assert count(state, 'stamps backwards') > count(before, 'stamps backwards')
    latency = state['latency stamp to published p50 [ms]']
    assert not latency or float(latency) >= 0


def test_counts_add_up_after_all_that(rig):
    state = rig.peer.wait_for_state(
        lambda s: s['worker'] == 'idle' and count(s, 'frames waiting') == 0, ANSWER_S, 'idle node'
    )
    assert count(state, 'frames received') == (
        count(state, 'frames processed') + count(state, 'frames dropped')
    )
