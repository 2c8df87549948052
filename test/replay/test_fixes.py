"""Where a drone was, and where it went, from its fixes."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.replay.fixes import NoPlace, Track, fix_from_msg
from rsmb_ros.replay.ground import metres_per_degree

S = 10**9  # ns
ALONG, ACROSS = metres_per_degree(47.0)


def fix(seconds, north=0.0, east=0.0, altitude=500.0, status=0, longitude=8.0):
    """Return a NavSatFix; north and east [m] of 47 N."""
    sec, nanosec = divmod(round(seconds * S), S)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec)),
        status=SimpleNamespace(status=status),
        latitude=47.0 + north / ALONG,
        longitude=longitude + east / ACROSS,
        altitude=altitude,
    )


def track(messages):
    return Track(filter(None, map(fix_from_msg, messages)))


def test_place_is_on_the_line_between_two_fixes():
    flown = track([fix(11, north=10, altitude=510), fix(10)])  # in any order
    place = flown.at(round(10.25 * S))
    assert (place.latitude - 47.0) * ALONG == pytest.approx(2.5, abs=1e-6)
    assert place.altitude == pytest.approx(502.5)
    assert flown.at(11 * S).altitude == 510.0


@pytest.mark.parametrize('seconds', [9.0, 11.5])
def test_there_is_no_place_outside_of_the_fixes(seconds):
    with pytest.raises(NoPlace, match='no fix before and after'):
        track([fix(10), fix(11)]).at(round(seconds * S))


def test_there_is_no_place_in_a_long_gap():
    with pytest.raises(NoPlace, match=r'3\.5 s between two fixes, at most 2 s'):
        track([fix(10), fix(13.5)]).at(11 * S)


@pytest.mark.parametrize(
    'bad', [{'status': -1}, {'north': np.nan}, {'east': np.inf}, {'north': 5e6}, {'longitude': 1e9}]
)
def test_messages_without_a_fix_are_left_out(bad):
    assert len(track([fix(10), fix(10.5, **bad), fix(11)])) == 2


def test_impossible_stamp_is_damage():
    odd = fix(10)
    odd.header.stamp.nanosec = 2 * S
    with pytest.raises(MalformedMessage, match='nanosec'):
        fix_from_msg(odd)


@pytest.mark.parametrize(
    ('north', 'east', 'course'), [(5, 0, 0), (0, 5, 90), (-5, 0, 180), (0, -5, 270), (3, 3, 45)]
)
def test_course_is_that_of_the_way_around_a_frame(north, east, course):
    flown = track([fix(t, t * north, t * east) for t in (9, 10, 11)])
    assert flown.course(10 * S) == pytest.approx(course, abs=0.01)


def test_hovering_drone_has_no_course():
    flown = track([fix(t, north=0.3 * (t % 2)) for t in (9, 10, 11)])
    with pytest.raises(NoPlace, match='no course: moved by'):
        flown.course(10 * S)


def test_way_across_the_date_line_is_short():
    flown = track([fix(10, longitude=180.0 - 1e-5), fix(11, longitude=-180.0 + 1e-5)])
    assert (flown.at(round(10.5 * S)).longitude + 180.0) % 360.0 == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(NoPlace, match='no course'):
        flown.course(round(10.5 * S))
