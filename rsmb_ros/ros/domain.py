"""A ROS domain of one's own: nothing outside this machine or in another run is disturbed."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rsmb_ros.core.errors import RsmbError

# Above these, DDS' ports would run into those the system hands out; 0 is everybody's default.
_DOMAINS = range(1, 100)
_PORT_BASE = 22119  # as domain_coordinator does: who holds the port holds the domain


@contextmanager
def isolated_domain(log_folder: Path) -> Iterator[int]:
    """
    Put this process, and those it starts, into a free domain on this machine alone.

    To be entered before rclpy.init; the environment is as before when it is left.

    Parameters
    ----------
    log_folder : Path
        Receives the log files of ROS, instead of the home directory.

    Yields
    ------
    int
        The domain.

    Raises
    ------
    RsmbError
        If all domains are taken.

    """
    domain, lock = _free_domain()
    before = dict(os.environ)
    with lock:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        os.environ['ROS_LOG_DIR'] = str(log_folder)
        try:
            yield domain
        finally:
            os.environ.clear()
            os.environ.update(before)


def _free_domain() -> tuple[int, socket.socket]:
    for domain in _DOMAINS:
        lock = socket.socket()
        try:
            lock.bind(('127.0.0.1', _PORT_BASE + domain))
        except OSError:
            lock.close()
        else:
            return domain, lock
    raise RsmbError(
        f'all ROS domains from {_DOMAINS[0]} to {_DOMAINS[-1]} are taken on this machine; '
        'end other tests or demos'
    )
