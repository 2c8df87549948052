"""Tables of made-up measurements hold what can be worked out by hand."""

import math

import pytest

from rsmb_ros.core import Config
from rsmb_ros.evaluation.speed.frame_tables import (
    floor_table,
    registration_table,
    step_tables,
    total_table,
)
from rsmb_ros.evaluation.speed.probes import Memory, StartUp
from rsmb_ros.evaluation.speed.results import SpeedResults
from rsmb_ros.evaluation.speed.rows import RowTimes
from rsmb_ros.evaluation.speed.spread import Spread, number
from rsmb_ros.evaluation.speed.stream_tables import share_within, warm_ratio, worst_exposure
from rsmb_ros.evaluation.speed.timing import COLD, FLAT, GIVEN, WARM

NAN = math.nan


@pytest.fixture
def results(rates):
    """Return results without any measurement."""
    return SpeedResults(rates, Config(), {'parts': 'all'})


def cells(table, row=0):
    """Return a row of a table by its headings; of equal ones the last."""
    return dict(zip(table.head, table.rows[row], strict=True))


# -- frames --------------------------------------------------------------------------------------


def test_ratio_is_taken_frame_by_frame(frame_times, times, rates):
    """Of 20/100, 40/400 and 90/300 the median is 0.2; of the medians it would be 40/300."""
    pairs = ((20.0, 100.0), (40.0, 400.0), (90.0, 300.0))
    frames = [frame_times(ecc, {COLD: times(ours)}) for ours, ecc in pairs]
    row = registration_table(frames, rates).rows[0]
    assert row[0] == f'640x480 planar, {COLD}'
    assert row[1:6] == ['3', '0, 0', '40.0', '30.0 - 65.0', '300.0']
    assert row[6:9] == ['200.0 - 350.0', '0.200', '0.150 - 0.250']


def test_cost_of_a_pixel_and_distance_from_the_floor(frame_times, rates):
    row = cells(registration_table([frame_times()], rates))
    assert row['ns / px'] == f'{40e6 / (640 * 480):.0f}'
    assert row['floor ms'] == '3.00'  # 200 and 100 MFLOP at 100 GFLOP/s
    assert row['x floor'] == '13.3'


def test_lost_frames_are_counted(frame_times, times, rates):
    frames = [
        frame_times(ours={COLD: times(registered=False)}),
        frame_times(ecc_registered=False),
        frame_times(ecc_registered=False),
    ]
    assert registration_table(frames, rates).rows[0][2] == '1, 2'


def test_variants_and_kinds_have_rows_of_their_own(frame_times, times, rates):
    ours = {COLD: times(), GIVEN: times(20.0), FLAT: times(40.0, 5.0), WARM: times(10.0)}
    frames = [frame_times(ours=ours), frame_times(ours=ours, scene='layered')]
    kinds = ('640x480 planar', '640x480 layered')
    names = [row[0] for row in registration_table(frames, rates).rows]
    assert names == [f'{kind}, {name}' for kind in kinds for name in (COLD, GIVEN, WARM)]
    names = [row[0] for row in total_table(frames).rows]
    assert names == [f'{kind}, {name}' for kind in kinds for name in (COLD, FLAT, GIVEN, WARM)]


def test_end_to_end_is_beside_the_registration_of_ecc(frame_times):
    row = total_table([frame_times(ecc=51.0)]).rows[0]
    assert row[1] == '102'
    assert row[3] == '2.00'


def test_steps_that_are_not_taken_count_nothing(frame_times, times):
    frames = [frame_times(), frame_times(ours={COLD: times(change=0.0)})]
    frames[1].ours[COLD].steps_ms.pop('layers')
    (table,) = step_tables(frames)
    assert table.title == 'Where the time goes at 640x480'
    assert table.head == ['ms', f'planar, {COLD}', 'quartiles']
    steps = {name: (middle, spread) for name, middle, spread in table.rows}
    assert steps['coarse'] == ('10.0', '10.0 - 10.0')
    assert steps['layers'] == ('30.0', '15.0 - 45.0')
    assert steps['elsewhere'][0] == '2.0'
    assert steps['end to end'] == ('72.0', '57.0 - 87.0')
    assert steps['registered in colour'][0] == '5.0'


def test_steps_have_a_table_a_size_and_a_column_a_kind(frame_times, times):
    ours = {COLD: times(), WARM: times(10.0)}
    frames = [frame_times(ours=ours), frame_times(scene='layered'), frame_times(shape=(72, 128))]
    large, small = step_tables(frames)
    assert large.head[1::2] == [f'planar, {COLD}', f'planar, {WARM}', f'layered, {COLD}']
    assert small.title == 'Where the time goes at 128x72'
    assert all(len(row) == len(large.head) for row in large.rows)
    assert large.rows[-1][3:5] == ['-', '-']  # the colours of the warm stream are not timed


def test_floor_says_what_it_is_counted_from(frame_times, rates):
    memory = [Memory((480, 640), 2e8, 3e7), Memory((720, 1280), 2e8, 9e7)]
    table = floor_table([frame_times()], memory, rates)
    row = cells(table)
    assert (row['points'], row['instants a row'], row['unknowns a row']) == ('1000', '8.0', '48')
    assert (row['MFLOP fit'], row['MFLOP render'], row['MB touched']) == ('200', '100', '3')
    assert (row['peak MB above idle'], row['idle MB']) == ('30', '200')
    only_memory = cells(table, 1)
    assert (only_memory['size'], only_memory['points']) == ('1280x720', '-')
    assert only_memory['peak MB above idle'] == '90'


# -- stream --------------------------------------------------------------------------------------


def test_stream_is_judged_once_it_has_learned(stream_frame):
    frames = [stream_frame(0, 200.0, 100.0, exposure=80.0)]  # learning
    frames += [stream_frame(10, 20.0, 80.0, exposure=50.25), stream_frame(11, exposure=49.0)]
    frames += [stream_frame(12, 30.0, 60.0), stream_frame(13, exposure=50.0)]
    assert worst_exposure(frames) == pytest.approx(0.02)
    assert share_within(frames, 0.01) == 0.75
    assert warm_ratio(frames).median == pytest.approx(0.375)


def test_lost_frame_has_no_exposure_and_is_not_right(stream_frame):
    frames = [stream_frame(10), stream_frame(11, exposure=NAN, registered=False)]
    assert worst_exposure(frames) == 0.0
    assert share_within(frames, 0.01) == 0.5


def test_short_stream_has_nothing_to_tell(stream_frame):
    assert math.isnan(worst_exposure([stream_frame(3)]))
    assert math.isnan(share_within([stream_frame(3)], 0.01))
    assert math.isnan(warm_ratio([stream_frame(3, alone=5.0)]).median)


# -- the page ------------------------------------------------------------------------------------


def test_goals_say_what_is_met(results, frame_times, times, stream_frame):
    results.add(frame_times(200.0, {COLD: times(40.0), WARM: times(20.0)}))
    results.add(frame_times(400.0, {COLD: times(44.0)}, shape=(720, 1280)))
    results.add(frame_times(1.0, {COLD: times(44.0)}, shape=(240, 320)))  # nothing asked for
    results.add(RowTimes((256, 384), 'authors/00', times(900.0)))
    results.add(stream_frame(10, 20.0, 40.0, exposure=51.0))
    results.add(stream_frame(11, registered=False, exposure=NAN))
    found = {goal.what: goal for goal in results.goals()}
    measured = {what: round(goal.measured, 4) for what, goal in found.items()}
    registration = 'registration and rendering'
    assert measured == {
        f'{registration}, 640x480, {COLD}, x ECC': 0.2,
        f'{registration}, 640x480, {WARM}, x ECC': 0.1,
        f'{registration}, 1280x720, {COLD}, x ECC': 0.11,
        f'end to end, 640x480, {COLD}, x ECC': 0.51,  # 40 + 60 + 2 of 200 ms
        f'end to end, 1280x720, {COLD}, x ECC': 0.265,
        'row estimator, 3 degrees of freedom, 384x256, s': 0.9,
        'stream: largest exposure error after 10 frames': 0.02,
        'stream: frames not registered': 1,
        'stream: warm over cold start': 0.5,
    }
    met = [False, True, False, False, False, True, False, False, True]
    assert [goal.met for goal in found.values()] == met
    assert [goal.cells[3] for goal in found.values()][:3] == ['no', 'yes', 'no']


def test_layers_off_has_a_goal_of_its_own(results, frame_times, times):
    results.add(frame_times(1000.0, {COLD: times(40.0, 98.0), FLAT: times(40.0, 98.0)}))
    goals = {goal.what: goal for goal in results.goals()}
    assert goals[f'end to end, 640x480, {COLD}, x ECC'].met  # 0.14 of 0.18
    assert not goals[f'end to end, 640x480, {FLAT}, x ECC'].met  # 0.14 of 0.13


def test_goal_that_was_not_measured_is_neither_met_nor_missed(results, stream_frame):
    results.add(stream_frame(0))
    assert [goal.cells[2:] for goal in results.goals()] == [['-', '-'], ['0', 'yes'], ['-', '-']]


def test_nothing_measured_gives_no_tables(results):
    assert results.tables() == []


def test_page_says_on_what_it_was_measured(results, frame_times, times, stream_frame):
    results.add(frame_times())
    results.add(Memory((480, 640), 2e8, 3e7))
    results.add(RowTimes((256, 384), 'authors/00', times(150.0)))
    results.add(StartUp(False, 1.5, 40.0))
    results.add(stream_frame(0))
    page = results.as_markdown()
    for line in ('# Speed', '* parts: all', '* threads: 2', '* machine: ', '* date: 20'):
        assert f'\n{line}' in f'\n{page}'
    assert '* peak: 100 GFLOP/s, 10.0 GB/s' in page
    titles = [line for line in page.splitlines() if line.startswith('**')]
    assert len(titles) == len(results.tables()) == 8
    assert '| kernels to compile | 1 | 1.5 | 1.5 - 1.5 | 40.0 | 40.0 - 40.0 |' in page
    assert '| 384x256 | 1 | 0 | 0.150 |' in page


def test_spread_leaves_out_what_is_not_known():
    assert Spread.of([1.0, NAN, 3.0, 2.0]) == Spread(1.5, 2.0, 2.5)
    assert Spread.of([]).cells('.1f') == ('-', '-')
    assert number(NAN, '.1f') == '-'
