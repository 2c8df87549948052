"""Diagnostics: one verdict, the gravest first, and numbers that can be checked by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.ros.health import ERROR, OK, STALE, WARN, WINDOW_S, Health, NodeState
from rsmb_ros.ros.worker import Counts

VALID = np.full((4, 5), 255, np.uint8)
VALID[0] = 0
GOOD = SimpleNamespace(
    status='registered',
    reason='',
    exposure_rows=20.0,
    valid_mask=VALID,
    residual=np.where(VALID > 0, np.float32(-3.0), np.float32(0.0)),
    row_uncertainty=np.array([np.nan, 0.1, 0.2, 0.4]),
)
BAD = SimpleNamespace(
    status='not_registered',
    reason='no overlap',
    exposure_rows=float('nan'),
    valid_mask=np.zeros((4, 5), np.uint8),
    residual=np.zeros((4, 5), np.float32),
    row_uncertainty=np.full(4, np.nan),
)
IDLE = NodeState('active', 'idle')


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def health(clock):
    """Return the health of a node that works: reference, frame, result."""
    health = Health(clock)
    health.reference_received()
    health.frame_received()
    health.published(GOOD, turnaround_s=0.05, latency_s=0.06)
    return health


def report(health, state=IDLE):
    return health.report(Counts(), state)


def test_working_node_is_ok(health):
    assert (report(health).level, report(health).message) == (OK, 'registered')


def test_dead_worker_is_an_error_before_all_else(health):
    health.malformed('size')
    assert report(health, NodeState('active', 'ended')).level == ERROR


def test_failure_is_an_error_while_it_is_recent(health, clock):
    health.failed(ValueError('boom'))
    assert report(health).level == ERROR
    assert 'ValueError: boom' in report(health).message
    clock.now += WINDOW_S + 1
    health.frame_received()
    health.published(GOOD, 0.05, None)
    assert report(health).level == OK


def test_malformed_messages_warn_and_stay_counted_by_cause(health, clock):
    for cause in ('size', 'size', 'encoding'):
        health.malformed(cause)
    now = report(health)
    assert (now.level, now.message) == (WARN, '3 malformed messages in 5 s: encoding, size')
    clock.now += WINDOW_S + 1
    values = report(health).values
    assert values['malformed messages'] == '3'
    assert (values['malformed: size'], values['malformed: encoding']) == ('2', '1')


def test_silence_is_stale_and_says_for_how_long(health, clock):
    assert report(Health(clock)).level == STALE
    assert report(Health(clock)).message == 'no live frame yet'
    clock.now += 7.0
    assert (report(health).level, report(health).message) == (STALE, 'no live frame for 7 s')


def test_frames_without_reference_warn(clock):
    health = Health(clock)
    health.frame_received()
    assert (report(health).level, report(health).message) == (WARN, 'no reference yet')
    assert report(health).values['reference'] == 'absent'


def test_frames_without_results_warn(health, clock):
    clock.now += WINDOW_S + 1
    health.frame_received()
    assert report(health).level == WARN
    assert 'no result' in report(health).message


def test_unregistered_frame_warns_with_its_reason(health):
    health.published(BAD, 0.05, 0.06)
    assert (report(health).level, report(health).message) == (WARN, 'not_registered: no overlap')
    assert report(health).values['exposure [rows]'] == ''


def test_numbers_are_those_of_the_window(clock):
    health = Health(clock)
    clock.now += 50.0  # long before: not in the rates
    health.frame_received()
    clock.now += WINDOW_S + 0.1
    for k in range(1, 21):
        health.frame_received()
        health.published(GOOD, turnaround_s=k * 1e-3, latency_s=k * 2e-3)
    values = report(health).values
    assert values['input rate [Hz]'] == values['output rate [Hz]'] == '4.00'
    # Nearest rank of 1..20 ms.
    assert values['latency arrival to published p50 [ms]'] == '10.0'
    assert values['latency arrival to published p95 [ms]'] == '19.0'
    assert values['latency stamp to published p50 [ms]'] == '20.0'


def test_frames_without_a_stamp_have_no_latency_from_it(clock):
    health = Health(clock)
    health.published(GOOD, turnaround_s=0.01, latency_s=None)
    values = report(health).values
    assert values['latency stamp to published p95 [ms]'] == ''
    assert values['latency arrival to published p95 [ms]'] == '10.0'


def test_counts_and_reference_age_are_passed_on(health, clock):
    clock.now += 3.0
    counts = Counts(9, 4, {'newer frame': 2, 'no reference': 1}, waiting=2)
    values = health.report(counts, IDLE).values
    names = ('received', 'processed', 'dropped', 'waiting')
    assert [values[f'frames {name}'] for name in names] == ['9', '4', '3', '2']
    assert values['dropped: newer frame'] == '2'
    assert values['reference age [s]'] == '3.0'
    assert values['references received'] == '1'


def test_task_beyond_its_deadline_is_an_error_while_it_lasts(health):
    late = report(health, NodeState('active', 'busy', busy_s=7.5, deadline_s=5.0))
    assert (late.level, late.message) == (ERROR, 'in work for 7.5 s, worker.deadline_s = 5')
    assert late.values['worker'] == 'busy'
    assert report(health, NodeState('active', 'busy', 4.9, 5.0)).level == OK


def test_frame_that_took_too_long_warns_and_stays_counted(health, clock):
    health.slow(6.0)
    assert report(health).level == WARN
    assert report(health).message == '1 frames over worker.deadline_s, up to 6.0 s'
    clock.now += WINDOW_S + 1
    health.frame_received()
    health.published(GOOD, 0.05, None)
    assert report(health).level == OK
    assert report(health).values['frames over deadline'] == '1'


@pytest.mark.parametrize('state', ['unconfigured', 'configuring', 'inactive', 'finalized'])
def test_node_that_is_not_active_warns(health, state):
    now = report(health, NodeState(state, 'none'))
    assert (now.level, now.message) == (WARN, f'not active: {state}')


def test_paused_node_warns(health):
    now = report(health, NodeState('active', 'idle', paused=True))
    assert (now.level, now.message) == (WARN, 'paused by ~/enable')


def test_odd_stamps_warn_and_stay_counted_by_kind(health, clock):
    for kind in ('backwards', 'repeated', 'repeated'):
        health.odd_stamp(kind)
    now = report(health)
    assert (now.level, now.message) == (WARN, '3 odd stamps: backwards, repeated')
    assert (now.values['stamps repeated'], now.values['stamps backwards']) == ('2', '1')


def test_latency_below_zero_says_nothing_of_us(health):
    before = report(health).values['latency stamp to published p95 [ms]']
    health.published(GOOD, 0.05, latency_s=-3600.0)
    assert report(health).values['latency stamp to published p95 [ms]'] == before == '60.0'


def test_reference_that_was_refused_is_absent(health):
    health.reference_lost()
    assert (report(health).level, report(health).message) == (WARN, 'no reference yet')


def test_quality_of_the_last_registration_is_told(health):
    values = report(health).values
    assert values['residual mean [grey levels]'] == '3.00'  # where judged
    assert values['judged [%]'] == '75.0'
    assert values['row uncertainty median [px]'] == '0.200'
    health.published(BAD, 0.05, None)
    values = report(health).values
    assert [values['residual mean [grey levels]'], values['judged [%]']] == ['', '0.0']
