"""Diagnostics: one verdict, the gravest first, and numbers that can be checked by hand."""

from types import SimpleNamespace

import pytest

from rsmb_ros.ros.health import ERROR, OK, STALE, WARN, WINDOW_S, Health
from rsmb_ros.ros.worker import Counts

GOOD = SimpleNamespace(status='registered', reason='', exposure_rows=20.0)
BAD = SimpleNamespace(status='not_registered', reason='no overlap', exposure_rows=float('nan'))


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


def report(health, worker_alive=True):
    return health.report(Counts(), worker_alive)


def test_working_node_is_ok(health):
    assert (report(health).level, report(health).message) == (OK, 'registered')


def test_dead_worker_is_an_error_before_all_else(health):
    health.malformed('size')
    assert report(health, worker_alive=False).level == ERROR


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
    values = health.report(Counts(9, 4, 2, 2, 1), worker_alive=True).values
    names = ('received', 'processed', 'without reference', 'dropped', 'failed')
    assert [values[f'frames {name}'] for name in names] == ['9', '4', '2', '2', '1']
    assert values['reference age [s]'] == '3.0'
    assert values['references received'] == '1'
