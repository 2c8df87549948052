"""Which frames are replayed, and what is said where there is none."""

import pytest

from rsmb_ros.bags.recording import Label, NoMore
from rsmb_ros.core.errors import ConfigError
from rsmb_ros.replay.selection import Picker, Selection

S = 10**9
FIRST = 1_700_000_000 * S


def picked(selection, stamps=tuple(FIRST + n * S for n in range(10))):
    picker, found = Picker(selection, '/image'), []
    try:
        for index, stamp in enumerate(stamps):
            assert picker(Label('/reference/image', 0, stamp, stamp))
            if picker(Label('/image', index, stamp, stamp)):
                found.append(index)
    except NoMore:
        pass
    picker.check()
    return found


@pytest.mark.parametrize(
    ('selection', 'found'),
    [
        (Selection(), list(range(10))),
        (Selection(start_ns=2 * S), list(range(2, 10))),
        (Selection(start_ns=2 * S + 1), list(range(3, 10))),
        (Selection(end_ns=3 * S), [0, 1, 2, 3]),
        (Selection(FIRST + 4 * S, FIRST + 6 * S), [4, 5, 6]),
        (Selection(4 * S, FIRST + 6 * S), [4, 5, 6]),
        (Selection(stride=4), [0, 4, 8]),
        (Selection(start_ns=1 * S, stride=4), [1, 5, 9]),
        (Selection(max_frames=3), [0, 1, 2]),
        (Selection(3 * S, None, 2, 2), [3, 5]),
    ],
)
def test_frames_are_picked_by_time_stride_and_number(selection, found):
    assert picked(selection) == found


def test_stamps_a_little_out_of_order_are_all_met():
    stamps = [FIRST, FIRST + 4 * S, FIRST + 2 * S, FIRST + 5 * S, FIRST + 3 * S]
    assert picked(Selection(end_ns=3 * S), stamps) == [0, 2, 4]


def test_reading_ends_where_nothing_more_is_wanted():
    for selection in (Selection(end_ns=1 * S), Selection(max_frames=1)):
        picker = Picker(selection, '/image')
        assert picker(Label('/image', 0, FIRST, FIRST))
        with pytest.raises(NoMore):
            picker(Label('/image', 1, FIRST + 20 * S, FIRST + 20 * S))


def test_frame_without_a_stamp_counts_by_its_log_time():
    picker = Picker(Selection(start_ns=2 * S), '/image')
    assert [picker(Label('/image', n, FIRST + n * S, 0)) for n in range(4)] == [0, 0, 1, 1]


@pytest.mark.parametrize(
    ('selection', 'told'),
    [
        (Selection(start_ns=60 * S), r'--start 60 s: no frame of /image; its frames lie from 0 s'),
        (Selection(end_ns=FIRST - S), r'--end 1699999999 s: .* stamps from 1700000000 s to'),
        (Selection(S // 4, S // 2), r'--start 0\.25 s --end 0\.5 s: no frame'),
    ],
)
def test_times_without_frames_say_where_the_frames_lie(selection, told):
    with pytest.raises(ConfigError, match=told):
        picked(selection)


@pytest.mark.parametrize(
    ('options', 'told'),
    [
        ({'stride': 0}, '--stride 0 must be at least 1'),
        ({'max_frames': 0}, '--max-frames 0 must be at least 1'),
        ({'start_ns': -S}, '--start -1 s must not be below 0 s'),
        ({'start_ns': 5 * S, 'end_ns': 4 * S}, '--end 4 s is before --start 5 s'),
    ],
)
def test_impossible_selection_is_refused(options, told):
    with pytest.raises(ConfigError, match=told):
        Selection(**options)


@pytest.mark.parametrize(
    ('options', 'about'),
    [
        ({}, 100),
        ({'start_ns': 75 * S}, 25),
        ({'end_ns': FIRST + 10 * S}, 10),
        ({'start_ns': 20 * S, 'end_ns': 60 * S, 'stride': 4}, 10),
        ({'start_ns': 20 * S, 'max_frames': 7}, 7),
        ({'start_ns': 99999 * S}, 1),
    ],
)
def test_frames_to_come_are_guessed_from_the_times(options, about):
    chosen = Selection(**options)
    assert chosen.expected(100, (FIRST, FIRST + 100 * S)) == about
    assert chosen.expected(100, None) == chosen.at_most(100)


@pytest.mark.parametrize(
    ('options', 'most'), [({}, 10), ({'stride': 3}, 4), ({'stride': 3, 'max_frames': 2}, 2)]
)
def test_number_of_frames_to_come(options, most):
    assert Selection(**options).at_most(10) == most
