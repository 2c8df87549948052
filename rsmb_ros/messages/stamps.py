"""Time stamps of messages."""

from typing import Any

from .errors import MalformedMessage

NS_PER_S = 1_000_000_000


def stamp_ns(stamp: Any) -> int:
    """
    Return a builtin_interfaces/Time as nanoseconds.

    Raises
    ------
    MalformedMessage
        If a field is outside what a time can be.

    """
    if stamp.sec < 0 or not 0 <= stamp.nanosec < NS_PER_S:
        raise MalformedMessage(
            'stamp',
            f'stamp is {stamp.sec} s {stamp.nanosec} ns, '
            f'must be sec >= 0 and nanosec 0 to {NS_PER_S - 1}',
        )
    return stamp.sec * NS_PER_S + stamp.nanosec
