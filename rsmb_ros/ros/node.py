"""The node: a managed one that takes itself to active; the work is done in the worker's thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rclpy.parameter
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_srvs.srv import SetBool, Trigger

from rsmb_ros.core.errors import ConfigError, RsmbError
from rsmb_ros.messages.camera_info import Intrinsics

from . import parameters
from .answering import Answering
from .endpoints import publisher
from .health import ACTIVE, Health, NodeState
from .logs import LOG_EVERY_S
from .managed import answer_wrong_transitions, telling
from .outputs import INACTIVE, Outputs
from .processing import Processing
from .reception import PAUSED, Frame, Reception
from .references import References
from .subscriptions import Subscriptions, Topics
from .worker import Counts, Worker

_DIAGNOSTICS_EVERY_S = 1.0
_DONE, _REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class RsmbNode(LifecycleNode):
    """
    Node `rsmb`: see the README for its topics, states and parameters.

    Configured, it has publishers, services, a worker and compiled kernels; active, subscriptions
    too. Transitions run in the executor's thread.

    Raises
    ------
    ConfigError
        If a parameter is unknown or not allowed.

    """

    def __init__(self) -> None:
        super().__init__('rsmb', automatically_declare_parameters_from_overrides=True)
        self._settings = parameters.declare(self)
        self._compressed = self._settings.image_transport == 'compressed'
        self._topics = Topics.of(self, self._compressed)
        parameters.check_qos_overrides(self, {*self._topics, *Outputs.topics(self)})
        self._processing = Processing(self._settings.config, log=self.get_logger().warning)
        self._state = 'unconfigured'
        self._paused = self._stop_wanted = False
        self._health = Health()
        self._worker: Worker[Frame, References] | None = None
        self._outputs: Outputs | None = None
        self._reception: Reception | None = None
        self._listening: Subscriptions | None = None
        self._services_made: list[Any] = []
        self.problem: RsmbError | None = None  # why it could not start by itself
        depth = self._settings.config.publish.queue_depth
        self._diagnostics = publisher(self, DiagnosticArray, '/diagnostics', depth)
        # of the node's own clock a jump back, or a pause of simulated time, would silence us
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DIAGNOSTICS_EVERY_S, self._publish_diagnostics, clock=steady)
        self.add_post_set_parameters_callback(self._apply_parameters)
        answer_wrong_transitions(self)

    def start(self) -> None:
        """Become active, if that is wanted; to be called in the executor's thread."""
        if not self._settings.autostart:
            self.get_logger().info('autostart is false: waiting to be configured')
            return
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != _DONE:
                if not self._stop_wanted and self.problem is None:
                    self.problem = RsmbError('the node could not start; its log says why')
                return

    def stop(self, timeout_s: float) -> bool:
        """Stop the worker, from any thread; return whether it ended within the time."""
        self._stop_wanted = True
        worker = self._worker
        return worker is None or worker.stop(timeout_s)

    def destroy_node(self) -> None:
        """Leave the graph: rclpy 7.1 forgets the state machine, which would hold the node there."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def report(self, error: Exception) -> None:
        """Tell of an exception in a callback."""
        if not self._stop_wanted:
            self._health.failed(error)
            self.get_logger().error(
                f'callback failed: {type(error).__name__}: {error}',
                throttle_duration_sec=LOG_EVERY_S,
            )

    # -- transitions -------------------------------------------------------------------------

    @telling
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Compile the kernels and make what active and inactive share."""
        self._state = 'configuring'
        try:
            self._outputs = Outputs(self, self._settings.config.publish.queue_depth)
        except ConfigError as error:
            return self._give_up(error)
        answering = Answering(
            self._processing,
            self._outputs,
            self._health,
            now_ns=self._now_ns,
            unwanted=lambda: self._stop_wanted,
            log=self.get_logger(),
        )
        self._worker = worker = Worker(
            answering.prepare, answering.reference, answering.frame, answering.error
        )
        self._reception = Reception(
            self._compressed,
            worker,
            self._health,
            self._take_intrinsics,
            max_megapixels=lambda: self._processing.config.worker.max_megapixels,
            now_ns=self._now_ns,
            log=self.get_logger(),
        )
        self._services_made = [
            self.create_service(SetBool, '~/enable', self._on_enable),
            self.create_service(Trigger, '~/set_reference', self._on_set_reference),
        ]
        self.get_logger().info('compiling kernels')
        worker.start()
        if not self._wait(worker.wait_prepared) or not worker.usable:
            return self._give_up(None)
        self._state = 'inactive'
        return _DONE

    @telling
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe."""
        assert self._outputs and self._reception
        try:
            self._listening = Subscriptions(self, self._topics, self._compressed, self._reception)
        except ConfigError as error:
            self.get_logger().error(str(error))
            self.problem = error
            return _REFUSED
        self._state = ACTIVE
        self._set_gate()
        if self._topics.rectified:
            self.get_logger().warning(
                f'{self._topics.image} is rectified by its name: its rows are no longer read at '
                'one time each, which is what registration rests on; remap image to the '
                'unrectified images'
            )
        self.get_logger().info(
            f'ready: waiting for a reference on {self._topics.reference}, '
            f'frames on {self._topics.image}'
        )
        return _DONE

    @telling
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hear and say nothing any more; the reference is kept."""
        self._silence()
        self._state = 'inactive'
        return _DONE

    @telling
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything but parameters; compiled kernels stay compiled."""
        return self._release('unconfigured')

    @telling
    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Come to rest for ever, from any state."""
        return self._release('finalized')

    @telling
    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to the beginning after an exception in a transition."""
        return self._release('unconfigured')

    def _give_up(self, error: ConfigError | None) -> TransitionCallbackReturn:
        """Leave nothing of a configuration that failed."""
        if error is not None:
            self.get_logger().error(str(error))
            self.problem = error
        if not self._stop_wanted:
            self._release('unconfigured')
        return _REFUSED

    def _silence(self) -> None:
        if self._listening is not None:
            self._listening.destroy()
            self._listening = None
        if self._reception is not None:
            self._reception.next_is_reference = False
        if self._outputs is not None:
            self._outputs.close(INACTIVE)
        if self._worker is not None:
            self._worker.discard(INACTIVE)

    def _release(self, state: str) -> TransitionCallbackReturn:
        self._silence()
        worker = self._worker
        if worker is not None and not self._wait(worker.stop):
            return _REFUSED
        if self._outputs is not None:
            self._outputs.destroy()
        while self._services_made:
            self.destroy_service(self._services_made.pop())
        self._worker = self._outputs = self._reception = None
        self._processing = Processing(self._processing.config, log=self.get_logger().warning)
        self._health = Health()
        self._state = state
        return _DONE

    def _wait(self, done: Callable[[float], bool]) -> bool:
        """Wait for ``done(timeout_s)`` with diagnostics going on; False if the node is to stop."""
        while not done(_DIAGNOSTICS_EVERY_S):
            if self._stop_wanted:
                return False
            self._publish_diagnostics()
        return not self._stop_wanted

    # -- services and parameters -------------------------------------------------------------

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._paused = not request.data
        self._set_gate()
        if self._paused and self._worker is not None:
            self._worker.discard(PAUSED)
        response.success = True
        response.message = 'paused' if self._paused else 'enabled'
        return response

    def _on_set_reference(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = self._state == ACTIVE and self._reception is not None
        response.message = f'not active: {self._state}'
        if self._reception is not None and response.success:
            self._reception.next_is_reference = True
            response.message = f'the next frame on {self._topics.image} becomes the reference'
        return response

    def _set_gate(self) -> None:
        """Let results out only where they are wanted."""
        if self._reception is not None:
            self._reception.paused = self._paused
        if self._outputs is None or self._state != ACTIVE:
            return
        if self._paused:
            self._outputs.close(PAUSED)
        else:
            self._outputs.open()

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    def _take_intrinsics(self, intrinsics: Intrinsics) -> None:
        self._processing.intrinsics = intrinsics

    def set_parameters(
        self, parameter_list: list[rclpy.parameter.Parameter]
    ) -> list[SetParametersResult]:
        """Set one by one; a refusal says why in our words, see `set_parameters_atomically`."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(
        self, parameter_list: list[rclpy.parameter.Parameter]
    ) -> SetParametersResult:
        """Set all or none. Checked here, since rclpy's own range check would answer first."""
        try:
            parameters.changed(self._processing.config, parameter_list)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return super().set_parameters_atomically(parameter_list)

    def _apply_parameters(self, changes: list[rclpy.parameter.Parameter]) -> None:
        # an endpoint that is made declares its QoS
        ours = [change for change in changes if not parameters.is_of_qos(change.name)]
        self._processing.config = parameters.changed(self._processing.config, ours)

    # -- diagnostics -------------------------------------------------------------------------

    def _node_state(self) -> NodeState:
        deadline_s = self._processing.config.worker.deadline_s
        worker = self._worker
        if worker is None:
            return NodeState(self._state, 'none', paused=self._paused)
        busy_s = worker.busy_s
        if worker.stopping or worker.alive:
            doing = 'busy' if busy_s else 'idle' if worker.wait_prepared(0) else 'compiling'
        else:
            doing = 'ended'
        return NodeState(self._state, doing, busy_s, deadline_s, self._paused)

    def _publish_diagnostics(self) -> None:
        state = self._node_state()
        if state.busy_s > state.deadline_s:  # it may never end, so it cannot tell by itself
            self.get_logger().warning(
                f'in work for {state.busy_s:.1f} s, worker.deadline_s = {state.deadline_s:g}',
                throttle_duration_sec=LOG_EVERY_S,
            )
        report = self._health.report(self._worker.snapshot() if self._worker else Counts(), state)
        name = self.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=bytes([report.level]),
            name=f'{name.lstrip("/")}: change detection',
            message=report.message,
            hardware_id='none',
            values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)
