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
        self._ended = False
        self._changed = threading.Condition()
        self._process = subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, errors='replace'
        )
        self._reader = threading.Thread(target=self._read, name='node_log')
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
        self._process.stderr.close()  # type: ignore[union-attr]  # a pipe: see __init__

    def wait_for_log(self, pattern: str, timeout_s: float) -> None:
        """Return once a line of the log matches `pattern`; else `NodeProblem`."""

        def found() -> bool:
            return any(re.search(pattern, line) for line in self._lines)

        with self._changed:
            self._changed.wait_for(lambda: found() or self._ended, timeout_s)
            if found():
                return
        if self._ended:
            self._process.wait(_END_S)  # its log is closed, so it is about to
        self.check_alive()
        raise NodeProblem(f'the node did not say {pattern!r} in {timeout_s:g} s; {self._tail()}')

    def check_alive(self) -> None:
        """Raise `NodeProblem` if the node has ended by itself."""
        code = self._process.poll()
        if code is not None:
            self._reader.join()
            raise NodeProblem(f'the node ended with exit code {code}; {self._tail()}')

    def stop(self, timeout_s: float) -> None:
        """Send SIGINT; raise `NodeProblem` unless the node ends with 0 in time."""
        self.check_alive()
        self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired as error:
            raise NodeProblem(
                f'the node did not end within {timeout_s:g} s of SIGINT; {self._tail()}'
            ) from error
        if code != 0:
            self._reader.join()
            raise NodeProblem(f'the node ended with exit code {code} on SIGINT; {self._tail()}')

    def _read(self) -> None:
        with self._log.open('w') as log:
            for line in self._process.stderr or ():
                log.write(line)
                log.flush()
                with self._changed:
                    self._lines.append(line.rstrip())
                    self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _tail(self) -> str:
        return f'see {self._log}: ' + ' | '.join(self._lines[-_TAIL:])
