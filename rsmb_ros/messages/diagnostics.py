"""What a recording says of one frame, as a diagnostic_msgs/DiagnosticStatus: no clock times."""

from __future__ import annotations

from typing import NamedTuple

from rsmb_ros.core.types import REGISTERED, Result

from .quality import known_number, quality

DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
FRAME = 'frame'  # key of the frame's number
OK, WARN = 0, 1  # levels of a DiagnosticStatus


class StatusFields(NamedTuple):
    """Content of a diagnostic_msgs/DiagnosticStatus."""

    level: int  # OK or WARN
    name: str
    message: str
    hardware_id: str
    values: dict[str, str]


def frame_status(index: int, result: Result) -> StatusFields:
    """
    Return what is to be said of one frame.

    Parameters
    ----------
    index : int
        Number of the frame among the messages of its topic, from 0.
    result : Result

    """
    registered = result.status == REGISTERED
    return StatusFields(
        level=OK if registered else WARN,
        name='rsmb: frame',
        message=result.status if registered else f'{result.status}: {result.reason}',
        hardware_id='rsmb',
        values={
            FRAME: str(index),
            'status': result.status,
            'reason': result.reason,
            **quality(result),
            'exposure [rows]': known_number(result.exposure_rows, 1),
            'gain': known_number(result.gain, 4),
            'changes': str(len(result.changes)),
            'static regions': str(len(result.regions) - len(result.changes)),
        },
    )
