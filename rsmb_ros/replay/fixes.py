"""The track of a drone from its sensor_msgs/NavSatFix messages."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from rsmb_ros.messages.stamps import NS_PER_S, stamp_ns

from .ground import metres_per_degree

LONGEST_GAP_S = 2.0  # between two fixes; in between, the flight is taken for straight
LEAST_WAY_M = 2.0  # the course of a shorter way is mostly the error of the receiver
COURSE_S = 1.0  # the course is that of the way from so long before a frame to so long after


class NoPlace(Exception):
    """Why the place of a frame is not known, for people."""


@dataclass(frozen=True)
class Fix:
    """Where the receiver was."""

    latitude: float  # [deg]
    longitude: float  # [deg]
    altitude: float  # above the WGS84 ellipsoid [m]; NaN: not told


def fix_from_msg(message: Any) -> tuple[int, Fix] | None:
    """
    Return when [ns] and where a sensor_msgs/NavSatFix was, None if it is without a fix.

    That is one with a status below 0, or without the numbers of a place; at the poles there is no
    north.

    Raises
    ------
    MalformedMessage
        If its stamp is none.

    """
    stamp = stamp_ns(message.header.stamp)
    altitude = message.altitude if math.isfinite(message.altitude) else math.nan
    fix = Fix(message.latitude, message.longitude, altitude)
    known = abs(fix.latitude) < 89.9 and abs(fix.longitude) <= 360.0  # False for NaN
    return (stamp, fix) if known and message.status.status >= 0 else None


class Track:
    """
    Places over time.

    Parameters
    ----------
    fixes : iterable of (int, Fix)
        With their stamps [ns], in any order.

    """

    def __init__(self, fixes: Iterable[tuple[int, Fix]]) -> None:
        found = dict(fixes)
        self._stamps = np.array(sorted(found), np.int64)
        self._values = np.array([astuple(found[stamp]) for stamp in sorted(found)]).reshape(-1, 3)
        if len(self._values):  # a way across the date line does not go round the earth
            self._values[:, 1] = np.unwrap(self._values[:, 1], period=360.0)

    def __len__(self) -> int:
        return len(self._stamps)

    def at(self, stamp: int) -> Fix:
        """
        Return the place at a time [ns], on the straight line between the fixes around it.

        Raises
        ------
        NoPlace
            If there is no fix around it, or they are too far apart.

        """
        after = int(np.searchsorted(self._stamps, stamp))
        if after < len(self) and self._stamps[after] == stamp:
            return Fix(*map(float, self._values[after]))
        if after in (0, len(self)):
            raise NoPlace('no fix before and after the frame')
        first, second = self._stamps[after - 1 : after + 1]
        gap_s = float(second - first) / NS_PER_S
        if gap_s > LONGEST_GAP_S:
            raise NoPlace(f'{gap_s:.1f} s between two fixes, at most {LONGEST_GAP_S:g} s')
        share = float(stamp - first) / float(second - first)
        before, behind = self._values[after - 1 : after + 1]
        return Fix(*map(float, before + share * (behind - before)))

    def course(self, stamp: int) -> float:
        """
        Return the course over ground at a time [ns], clockwise from true north [deg].

        Raises
        ------
        NoPlace
            If the place around is not known, or the drone hardly moves.

        """
        reach = round(COURSE_S * NS_PER_S)
        ends = np.clip([stamp - reach, stamp + reach], self._stamps[0], self._stamps[-1])
        first, last = (self.at(int(end)) for end in ends)
        along, across = metres_per_degree(first.latitude)
        north = (last.latitude - first.latitude) * along
        east = (last.longitude - first.longitude) * across
        way = math.hypot(north, east)
        if way < LEAST_WAY_M:
            raise NoPlace(f'no course: moved by {way:.1f} m, at least {LEAST_WAY_M:g} m are needed')
        return math.degrees(math.atan2(east, north)) % 360.0
