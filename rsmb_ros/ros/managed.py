"""What rclpy's managed node leaves open: exceptions in transitions, and transitions out of turn."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

N = TypeVar('N', bound=LifecycleNode)


def telling(
    transition: Callable[[N, LifecycleState], TransitionCallbackReturn],
) -> Callable[[N, LifecycleState], TransitionCallbackReturn]:
    """Log what a transition raises: rclpy goes on to `on_error` without a word."""

    @wraps(transition)
    def run(node: N, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(node, state)
        except Exception as error:
            node.get_logger().error(f'{transition.__name__}: {type(error).__name__}: {error}')
            raise

    return run


def answer_wrong_transitions(node: LifecycleNode) -> None:
    """Answer a transition that the present state does not know: rclpy 7.1 ends the spin instead."""
    service = node._service_change_state
    change_state = service.callback

    def answer(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except rclpy_implementation.RCLError as error:
            reason = str(error).splitlines()[0]
            node.get_logger().warning(f'transition {request.transition.id} refused: {reason}')
            response.success = False
            return response

    service.callback = answer
