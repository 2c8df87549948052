"""Every frame has its place on the strip, and every bar leads to a frame."""

import re

import numpy as np
import pytest

from rsmb_ros.report.flight.records import FrameRecord, outcome
from rsmb_ros.report.flight.timeline import HEIGHT, MOST_BINS, timeline


def record(n, changes=0, reason='', exposure=40.0):
    lost = bool(reason)
    number = float('nan') if lost else exposure
    unknown = 1.0 if lost else 0.1
    return FrameRecord(n, n, not lost, reason, changes, 0, 0.9 * bool(changes), number, unknown, 1)


def strip(records, shown=()):
    return timeline(records, shown, lambda one: f'row-{one.index}', lambda one: f'{one.index} s')


@pytest.mark.parametrize('count', [1, 2, 240, 241, 1000, 100_000])
def test_bars_are_as_many_as_a_phone_can_show(count):
    found = strip([record(n) for n in range(count)])
    assert len(found.bins) <= min(count, MOST_BINS)
    assert len(found.bins) * found.per_bin >= count
    assert found.marks[0][1] == '0 · 0 s'
    assert found.marks[-1][1] == f'{count - 1} · {count - 1} s'


def test_heights_are_the_numbers_of_changes():
    lane = strip([record(0), record(1, 1), record(2, 4), record(3)]).lanes[0]
    heights = [float(h) for h in re.findall(r'v([\d.]+)h?', lane.alarms.replace('v-', 'w-'))]
    assert heights == [HEIGHT / 4, HEIGHT]
    assert lane.note == 'in 2 frames, at most 4'


def test_a_frame_that_is_not_registered_is_seen_among_many():
    records = [record(n, reason='no overlap: 3%' * (n == 700)) for n in range(1000)]
    found = strip(records)
    lane = found.lanes[1]
    assert lane.note == '1 not registered'
    assert lane.losses.count('M') == 1
    assert lane.bars.count('M') == len(found.bins) - 1


def test_exposure_is_interrupted_where_it_is_not_known():
    found = strip([record(0, exposure=30), record(1, reason='x'), record(2, exposure=60)])
    assert found.lanes[2].note == '30 to 60 rows'
    assert found.lanes[2].curve.count('M') == 2
    assert strip([record(0, reason='x')]).lanes[2].note == 'not known'


def test_a_bar_leads_to_the_frame_one_wants_to_see():
    records = [record(n, changes=n == 501) for n in range(1000)]
    targets = [one.target for one in strip(records, shown={3, 502}).bins]
    assert targets[0] == 'row-3'  # has pictures
    assert targets[100] == 'row-502'
    assert strip(records).bins[100].target == 'row-501'
    assert 'frames 500 to 504; frame 501, 501 s: 1 change' in strip(records).bins[100].label


def test_outcome_begins_with_what_matters():
    assert outcome(record(0, 2))[0] == '2 changes'
    assert outcome(record(0))[0] == 'no change'
    assert outcome(record(0, reason='no overlap: 3%')) == ['not registered', 'no overlap: 3%']
    assert np.isnan(record(0, reason='x').exposure_rows)
