"""The node: messages in, messages out; the work is done in the worker's thread."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy.parameter
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Float32MultiArray, Header, String

from rsmb_ros.core.config import Config
from rsmb_ros.core.depth_map import checked_depth
from rsmb_ros.core.errors import ConfigError, FrameError
from rsmb_ros.core.types import Result
from rsmb_ros.messages.errors import MalformedMessage
from rsmb_ros.messages.images import depth_from_msg, image_from_compressed, image_from_msg
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT
from rsmb_ros.messages.stamps import stamp_ns

from . import parameters
from .factory import RclpyFactory
from .health import Health
from .pairing import Pair, Pairing
from .processing import Processing
from .worker import Worker

_MESSAGE_CLASSES = {IMAGE: Image, ROWS: Float32MultiArray, TEXT: String}
_LOG_EVERY_S = 5.0
_DIAGNOSTICS_EVERY_S = 1.0


@dataclass(frozen=True)
class _Frame:
    """A live image on its way to the worker."""

    image: np.ndarray  # (M, N) or (M, N, 3) uint8 BGR
    header: Header
    stamp_ns: int
    arrived_s: float  # time.monotonic


class RsmbNode(Node):
    """
    Node `rsmb`: see the README for its topics and parameters.

    Raises
    ------
    ConfigError
        If a parameter is unknown or not allowed.

    """

    def __init__(self) -> None:
        super().__init__('rsmb', automatically_declare_parameters_from_overrides=True)
        config, transport = parameters.declare(self)
        self._processing = Processing(config, log=self.get_logger().warning)
        self._health = Health()
        self._factory = RclpyFactory()
        self._pairing = Pairing()
        self._worker: Worker[_Frame, Pair] = Worker(
            prepare=self._prepare,
            on_reference=lambda pair: self._processing.set_reference(pair.image, pair.depth),
            on_frame=self._process,
            on_error=self._on_error,
        )
        self._create_outputs(config)
        self._subscribe(compressed=transport == 'compressed')
        self.add_post_set_parameters_callback(self._apply_parameters)

    def start(self) -> None:
        """Start the worker and say what the node waits for."""
        self._worker.start()
        reference, _, image, _ = (s.topic_name for s in self._inputs)
        self.get_logger().info(f'ready: waiting for a reference on {reference}, frames on {image}')

    def stop(self, timeout_s: float) -> bool:
        """Stop the worker; return whether it ended within the time."""
        return self._worker.stop(timeout_s)

    # -- endpoints ---------------------------------------------------------------------------

    def _create_outputs(self, config: Config) -> None:
        depth = config.publish.queue_depth
        self._outputs = [
            (output, self._publisher(_MESSAGE_CLASSES[output.type], f'~/{output.name}', depth))
            for output in OUTPUTS
        ]
        self._diagnostics = self._publisher(DiagnosticArray, '/diagnostics', depth)
        self.create_timer(_DIAGNOSTICS_EVERY_S, self._publish_diagnostics)

    def _publisher(self, message_class: type, topic: str, depth: int) -> Any:
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
        overrides = QoSOverridingOptions.with_default_policies()
        return _with_qos(
            topic,
            lambda: self.create_publisher(
                message_class, topic, qos, qos_overriding_options=overrides
            ),
        )

    def _subscribe(self, compressed: bool) -> None:
        message_class, suffix = (CompressedImage, '/compressed') if compressed else (Image, '')
        self._image_of = image_from_compressed if compressed else image_from_msg
        # As image_transport does: a remap of `image` moves `image/compressed` too.
        image = self.resolve_topic_name('image') + suffix
        reference = self.resolve_topic_name('reference/image') + suffix
        depth = self.resolve_topic_name('reference/depth')
        # A volatile publisher matches only a volatile reader, and a latched image that was sent
        # before we started reaches only a transient-local one.
        self._subscription(message_class, reference, self._on_reference, 'latched')
        self._subscription(Image, depth, self._on_depth, 'latched')
        self._inputs = [
            self._subscription(message_class, reference, self._on_reference, 'volatile'),
            self._subscription(Image, depth, self._on_depth, 'volatile'),
            self._subscription(message_class, image, self._on_image),
            self._subscription(CameraInfo, 'camera_info', self._on_camera_info),
        ]

    def _subscription(
        self,
        message_class: type,
        topic: str,
        callback: Callable[[Any], None],
        entity: str | None = None,
    ) -> Any:
        """Subscribe with sensor-data QoS, newest message only; or, named 'latched', latched."""
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = entity == 'latched'
        if latched:
            qos.reliability = ReliabilityPolicy.RELIABLE
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        # rclpy would warn of publishers the latched one cannot match; its volatile twin does.
        events = SubscriptionEventCallbacks(use_default_callbacks=not latched)
        overrides = QoSOverridingOptions.with_default_policies(entity_id=entity)
        return _with_qos(
            topic,
            lambda: self.create_subscription(
                message_class,
                topic,
                callback,
                qos,
                event_callbacks=events,
                qos_overriding_options=overrides,
            ),
        )

    # -- in: convert, hand over, return ------------------------------------------------------

    def _on_image(self, msg: Any) -> None:
        try:
            frame = self._frame(msg)
        except MalformedMessage as error:
            self._health.malformed(error.cause)
            self.get_logger().warning(f'image skipped: {error}', throttle_duration_sec=_LOG_EVERY_S)
            return
        self._health.frame_received()
        self._worker.submit_frame(frame)

    def _on_reference(self, msg: Any) -> None:
        try:
            frame = self._frame(msg)
        except MalformedMessage as error:
            self._health.malformed(error.cause)
            self.get_logger().warning(
                f'reference skipped: {error}', throttle_duration_sec=_LOG_EVERY_S
            )
            return
        # A latched publisher reaches both subscriptions, and some repeat their image for ever:
        # an equal reference changes nothing.
        pair = self._pairing.image(frame.image, frame.stamp_ns)
        if pair is not None:
            self._health.reference_received()
            self._worker.submit_reference(pair)

    def _on_depth(self, msg: Image) -> None:
        try:
            depth = depth_from_msg(msg)
            pair = self._pairing.depth(
                checked_depth(depth, depth.shape), stamp_ns(msg.header.stamp)
            )
        except FrameError as error:
            self._health.malformed(getattr(error, 'cause', 'depth'))
            self.get_logger().warning(f'depth skipped: {error}', throttle_duration_sec=_LOG_EVERY_S)
            return
        if pair is not None:
            self._worker.submit_reference(pair)
        elif waiting := self._pairing.waiting():
            self.get_logger().info(
                f'depth waits for its reference: {waiting}', throttle_duration_sec=_LOG_EVERY_S
            )

    def _frame(self, msg: Any) -> _Frame:
        arrived_s = time.monotonic()
        return _Frame(self._image_of(msg), msg.header, stamp_ns(msg.header.stamp), arrived_s)

    def _on_camera_info(self, msg: CameraInfo) -> None:
        focal_px = float(msg.k[0])
        if math.isfinite(focal_px) and focal_px > 0:
            self._processing.info_focal_px = focal_px
        else:
            self.get_logger().warning(
                f'camera_info ignored: k[0] = {focal_px} px, the focal length, must be above 0',
                throttle_duration_sec=_LOG_EVERY_S,
            )

    # -- parameters --------------------------------------------------------------------------

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
        self._processing.config = parameters.changed(self._processing.config, changes)

    # -- in the worker's thread --------------------------------------------------------------

    def _prepare(self) -> None:
        start = time.monotonic()
        self._processing.prepare()
        self.get_logger().info(f'kernels compiled in {time.monotonic() - start:.1f} s')

    def _process(self, frame: _Frame) -> bool:
        result = self._processing.detect(frame.image, frame.stamp_ns or None)
        if result is None:
            return False
        if not self._worker.stopping:
            self._publish(result, frame)
        return True

    def _publish(self, result: Result, frame: _Frame) -> None:
        for output, publisher in self._outputs:
            if publisher.get_subscription_count():
                publisher.publish(output.build(result, frame.image, self._factory, frame.header))
        latency_ns = self.get_clock().now().nanoseconds - frame.stamp_ns
        self._health.published(
            result,
            turnaround_s=time.monotonic() - frame.arrived_s,
            latency_s=latency_ns * 1e-9 if frame.stamp_ns else None,
        )

    def _on_error(self, error: Exception) -> None:
        if not self._worker.stopping:
            self._health.failed(error)
            self.get_logger().error(
                f'processing failed: {type(error).__name__}: {error}',
                throttle_duration_sec=_LOG_EVERY_S,
            )

    # -- diagnostics -------------------------------------------------------------------------

    def _publish_diagnostics(self) -> None:
        report = self._health.report(self._worker.snapshot(), self._worker.alive)
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


def _with_qos(topic: str, create: Callable[[], Any]) -> Any:
    """Create an endpoint; a QoS override that rclpy cannot use is a wrong setting."""
    try:
        return create()
    except (InvalidQosOverridesError, RuntimeError, AssertionError, ValueError) as error:
        reason = str(error) or 'wrong type'
        raise ConfigError(f'qos_overrides of {topic} cannot be used: {reason}') from error
