"""The worker: newest frame wins, counts add up, errors do not end it, `stop` has a deadline."""

import threading

import pytest

from rsmb_ros.ros.worker import Counts, Worker

PATIENCE_S = 10.0


class Desk:
    """Handlers that record, and that wait at a gate when told to."""

    def __init__(self):
        self.handled = []
        self.errors = []
        self.busy = threading.Event()
        self.gate = threading.Event()
        self.gate.set()
        self._changed = threading.Condition()
        self.worker = Worker(self.prepare, self.reference, self.frame, self.error)

    def prepare(self):
        self._record('prepare')

    def reference(self, item):
        self._record(('reference', item))

    def frame(self, item):
        self.busy.set()
        assert self.gate.wait(PATIENCE_S), 'the test never opened the gate'
        if item == 'bad':
            self._record('raised')
            raise ValueError('bad frame')
        self._record(('frame', item))
        return 'no use' if item == 'unused' else ''

    def error(self, error):
        self.errors.append(str(error))

    def _record(self, what):
        with self._changed:
            self.handled.append(what)
            self._changed.notify_all()

    def wait_for(self, count):
        self.wait_until(lambda: len(self.handled) >= count)

    def wait_until(self, done):
        with self._changed:
            in_time = self._changed.wait_for(done, PATIENCE_S)
        assert in_time, f'not in {PATIENCE_S} s; handled: {self.handled[-20:]}'

    def hold_with(self, frame):
        """Submit `frame` and return while the worker is busy with it."""
        self.gate.clear()
        self.busy.clear()
        self.worker.submit_frame(frame)
        assert self.busy.wait(PATIENCE_S), f'{frame!r} was never taken up'


@pytest.fixture
def desk():
    desk = Desk()
    desk.worker.start()
    desk.wait_for(1)  # prepared
    yield desk
    desk.gate.set()
    assert desk.worker.stop(PATIENCE_S)


def test_newest_frame_wins_and_the_older_ones_are_counted(desk):
    desk.hold_with(0)
    for frame in (1, 2, 3):
        desk.worker.submit_frame(frame)
    desk.gate.set()
    desk.wait_for(3)
    assert desk.worker.stop(PATIENCE_S)
    assert desk.handled == ['prepare', ('frame', 0), ('frame', 3)]
    assert desk.worker.snapshot() == Counts(4, 2, {'newer frame': 2})


def test_reference_is_never_dropped_by_a_frame_and_goes_first(desk):
    desk.hold_with(0)
    desk.worker.submit_frame(1)
    desk.worker.submit_reference('r')
    desk.worker.submit_frame(2)
    desk.gate.set()
    desk.wait_for(4)
    assert desk.handled[2:] == [('reference', 'r'), ('frame', 2)]


def test_newer_reference_replaces_one_that_waits(desk):
    desk.hold_with(0)
    desk.worker.submit_reference('old')
    desk.worker.submit_reference('new')
    desk.worker.submit_frame(1)
    desk.gate.set()
    desk.wait_for(4)
    assert desk.handled[2:] == [('reference', 'new'), ('frame', 1)]


def test_error_is_reported_and_counted_and_the_next_frame_is_handled(desk):
    desk.worker.submit_frame('bad')
    desk.wait_for(2)
    desk.worker.submit_frame('good')
    desk.wait_for(3)
    assert desk.worker.alive
    assert desk.worker.stop(PATIENCE_S)
    assert desk.errors == ['bad frame']
    assert desk.worker.snapshot() == Counts(2, 1, {'exception': 1})


def test_frame_the_handler_had_no_use_for_is_skipped_not_processed(desk):
    desk.worker.submit_frame('unused')
    desk.wait_for(2)
    assert desk.worker.stop(PATIENCE_S)
    assert desk.worker.snapshot() == Counts(1, 0, {'no use': 1})


def test_counts_add_up_under_a_flood_from_several_threads(desk):
    def flood(start):
        for frame in range(start, start + 500):
            desk.worker.submit_frame(frame)

    senders = [threading.Thread(target=flood, args=(k * 500,)) for k in range(4)]
    for sender in senders:
        sender.start()
    for sender in senders:
        sender.join()
    desk.worker.submit_frame('last')
    desk.wait_until(lambda: ('frame', 'last') in desk.handled)
    assert desk.worker.stop(PATIENCE_S)
    counts = desk.worker.snapshot()
    assert counts.received == 2001
    assert counts.processed + counts.dropped_total == counts.received
    assert counts.processed == len(desk.handled) - 1  # without 'prepare'


def test_failed_preparation_is_reported_and_frames_are_handled_all_the_same():
    errors = []
    seen = threading.Event()

    def prepare():
        raise RuntimeError('no compiler')

    worker = Worker(prepare, lambda _: None, lambda _: seen.set() or '', errors.append)
    worker.start()
    worker.submit_frame(1)
    assert seen.wait(PATIENCE_S)
    assert worker.stop(PATIENCE_S)
    assert [str(error) for error in errors] == ['no compiler']
    assert worker.wait_prepared(0)
    assert not worker.usable


def test_stop_gives_up_at_its_deadline_while_a_frame_is_in_work(desk):
    desk.hold_with(0)
    assert not desk.worker.stop(timeout_s=0.05)
    assert desk.worker.stopping
    desk.gate.set()
    assert desk.worker.stop(PATIENCE_S)
    assert not desk.worker.alive


def test_frame_that_waits_at_stop_is_not_begun(desk):
    desk.hold_with(0)
    desk.worker.submit_frame(1)
    assert not desk.worker.stop(timeout_s=0.05)
    desk.gate.set()
    assert desk.worker.stop(PATIENCE_S)
    assert ('frame', 1) not in desk.handled


def test_counts_add_up_at_every_moment(desk):
    desk.hold_with(0)
    desk.worker.submit_frame(1)
    desk.worker.refuse('malformed')
    now = desk.worker.snapshot()
    assert now == Counts(3, 0, {'malformed': 1}, waiting=2)


def test_frame_that_waits_can_be_discarded_and_a_reference_is_kept(desk):
    desk.hold_with(0)
    desk.worker.submit_frame(1)
    desk.worker.submit_reference('r')
    desk.worker.discard('not active')
    desk.worker.submit_frame(2)
    desk.gate.set()
    desk.wait_for(4)
    assert desk.handled[1:] == [('frame', 0), ('reference', 'r'), ('frame', 2)]
    assert desk.worker.snapshot().dropped == {'not active': 1}


def test_time_in_work_is_told_while_it_lasts(desk):
    assert desk.worker.busy_s == 0.0
    desk.hold_with(0)
    first = desk.worker.busy_s
    assert 0 < first < desk.worker.busy_s
    desk.gate.set()
    desk.wait_for(2)
    assert desk.worker.stop(PATIENCE_S)
    assert desk.worker.busy_s == 0.0


def test_preparation_is_over_before_the_first_task(desk):
    assert desk.worker.wait_prepared(PATIENCE_S)
    assert desk.worker.usable
