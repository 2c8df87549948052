"""The node `rsmb` in a process of its own, as users start it."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

from rsmb_ros.core.errors import RsmbError

_TAIL = 6  # lines of the log in a message
_END_S = 5.0  # for a node that is not wanted any more


class NodeProblem(RsmbError):
    """The node ended, kept silent or broke a promise."""


class NodeProcess:
    """
    A running `rsmb_node`; a context manager that leaves nothing running.

    Parameters
    ----------
    ros_args : sequence of str
        What follows ``--ros-args``.
    log : Path
        Receives what the node writes to stderr.

    """

    def __init__(self, ros_args: Sequence[str], log: Path) -> None:
        command = [sys.executable, '-m', 'rsmb_ros.ros.main', '--ros-args', *ros_args]
        self._log = log
        self._lines: list[str] = []
        self._process = subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, errors='replace'
        )
        self._reader = threading.Thread(target=self._read, args=[self._process.stderr])
        self._reader.start()

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.terminate()  # a killed node leaves its shared memory behind
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def said(self, pattern: str) -> bool:
        """Return whether a line of the log matches `pattern`."""
        return any(re.search(pattern, line) for line in list(self._lines))

    def check_alive(self) -> None:
        """Raise `NodeProblem` if the node has ended."""
        code = self._process.poll()
        if code is not None:
            raise NodeProblem(f'the node ended with exit code {code}; {self._tail()}')

    def stop(self, timeout_s: float) -> None:
        """Send SIGINT; raise `NodeProblem` unless the node ends with 0 in time."""
        self.check_alive()
        self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise NodeProblem(
                f'the node did not end within {timeout_s:g} s of SIGINT; see {self._log}'
            ) from error
        if code != 0:
            raise NodeProblem(f'the node ended with exit code {code} on SIGINT; {self._tail()}')

    def _read(self, stream: IO[str]) -> None:
        with stream, self._log.open('w') as log:
            for line in stream:
                log.write(line)
                log.flush()
                self._lines.append(line.rstrip())

    def _tail(self) -> str:
        """Return the end of the log of a node that has ended."""
        self._reader.join()
        return f'see {self._log}: ' + ' | '.join(self._lines[-_TAIL:])
