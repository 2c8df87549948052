"""
Entry point `rsmb_node`.

Imports nothing heavy at the top: a signal that comes while rclpy is being imported must find our
handlers in place.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rclpy.executors import Executor

    from .node import RsmbNode

STOP_DEADLINE_S = 2.0  # `ros2 launch` kills after 5
_POLL_S = 0.05
_MOST_FAILURES = 10  # of callbacks in a second; then something is broken for good


class _StopRequest:
    """
    Remembers SIGINT or SIGTERM.

    A flag and not a `threading.Event`: the handler runs in the main thread, perhaps while that
    holds the event's lock, and a repeated signal would wait for it for ever.
    """

    def __init__(self) -> None:
        self.made = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._make)

    def _make(self, number: int, stack: Any) -> None:
        self.made = True


def main(args: list[str] | None = None) -> int:
    """
    Run the node until SIGINT or SIGTERM.

    Returns
    -------
    int
        0 after a signal; 2 if an argument or a parameter is refused (the reason is on stderr);
        1 if the node broke.

    """
    stop = _StopRequest()
    argv = sys.argv if args is None else ['rsmb_node', *args]

    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from rsmb_ros.core.errors import ConfigError
    from rsmb_ros.core.workers import take_short_turns

    from .node import RsmbNode
    from .transport import apply_profile

    take_short_turns()
    transport = apply_profile(os.environ, Path.cwd())
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        _parse(rclpy.utilities.remove_ros_args(argv)[1:])
    except RuntimeError as error:  # what rclpy raises for wrong --ros-args
        return _refuse(f'ROS arguments cannot be used: {error}')
    try:
        node = RsmbNode()
    except ConfigError as error:
        rclpy.try_shutdown()
        return _refuse(str(error))
    node.get_logger().info(f'transport: {transport}')
    return _run(node, stop)


def _parse(arguments: list[str]) -> None:
    """Exit with 0 after ``--help``, with 2 on any argument that is not for ROS."""
    parser = argparse.ArgumentParser(
        prog='rsmb_node',
        description='Registration and change detection under rolling-shutter motion blur. '
        'Everything is set by ROS arguments: --ros-args --params-file FILE, -p NAME:=VALUE, '
        '-r FROM:=TO.',
    )
    parser.parse_args(arguments)


def _refuse(reason: str) -> int:
    print(f'rsmb_node: {reason}', file=sys.stderr)
    return 2


def _run(node: RsmbNode, stop: _StopRequest) -> int:
    """Spin until told to stop, then take everything down in the one order that always works."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.create_task(node.start)  # transitions belong into the thread of their services
    spin = threading.Thread(target=_spin, args=[executor, node], name='rsmb_spin')
    spin.start()
    while not stop.made and node.problem is None and spin.is_alive():
        time.sleep(_POLL_S)
    node.stop(STOP_DEADLINE_S)
    executor.shutdown()
    spin.join()
    worker_ended = node.stop(0)  # again: a transition may have made another one meanwhile
    problem = node.problem
    node.destroy_node()
    rclpy.try_shutdown()
    code = _exit_code(stop, problem)
    if not worker_ended:
        # Compiling a kernel takes long and cannot be interrupted. Nothing of ROS is open any
        # more and numba's cache files appear whole or not at all, so leave the thread behind.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _spin(executor: Executor, node: RsmbNode) -> None:
    """Spin until shut down; one callback that raises does not end the node, a row of them does."""
    failures: deque[float] = deque(maxlen=_MOST_FAILURES)
    while len(failures) < _MOST_FAILURES or time.monotonic() - failures[0] > 1.0:
        try:
            return executor.spin()
        except Exception as error:
            failures.append(time.monotonic())
            node.report(error)
    return None


def _exit_code(stop: _StopRequest, problem: Exception | None) -> int:
    """Return 0 if asked to end, 2 if a setting was refused, 1 if the node broke."""
    from rsmb_ros.core.errors import ConfigError

    if stop.made:
        return 0
    if isinstance(problem, ConfigError):
        return _refuse(str(problem))
    if problem is not None:
        print(f'rsmb_node: {problem}', file=sys.stderr)
    return 1


if __name__ == '__main__':
    sys.exit(main())
