"""Plays images to a running node and records what it answers, over real topics."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Float32MultiArray, String

from rsmb_ros.bags.reading import CAMERA_INFO, COMPRESSED
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT
from rsmb_ros.messages.stamps import NS_PER_S, stamp_ns

from .node_process import NodeProblem, NodeProcess

_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_CLASSES = {
    IMAGE: Image,
    COMPRESSED: CompressedImage,
    CAMERA_INFO: CameraInfo,
    ROWS: Float32MultiArray,
    TEXT: String,
    _DIAGNOSTICS: DiagnosticArray,
}
_CAMERA_INFO_TOPIC = '/camera_info'
_ANSWER_S = 30.0  # for what a healthy node does at once, on a busy machine
_QUEUE = 100  # messages; everything published is to be recorded
_POLL_S = 0.02


@dataclass
class Answers:
    """What the node made of the frames it was played; keys are the frames' stamps [ns]."""

    played: dict[int, float] = field(default_factory=dict)  # stamp -> when [s]
    summaries: dict[int, dict[str, Any]] = field(default_factory=dict)  # of ~/regions_json
    arrived: dict[int, float] = field(default_factory=dict)  # stamp -> when its summary came [s]
    counts: dict[str, int] = field(default_factory=dict)  # of the node: 'processed' -> frames


class Playback:
    """
    A plain ROS node beside the one that is played to.

    Parameters
    ----------
    process : NodeProcess
        The node; if it ends, whatever waits for it raises `NodeProblem`.
    writer : BagWriter
        Receives everything that is played and answered, with the time of the wall clock.
    compressed : bool
        Images travel as CompressedImage.
    check : callable
        Called all the time; ends the playback by an exception.

    """

    def __init__(
        self,
        process: NodeProcess,
        writer: BagWriter,
        compressed: bool,
        check: Callable[[], None],
    ) -> None:
        self.answers = Answers()
        self._check = check
        self._process = process
        self._writer = writer
        self._kind = COMPRESSED if compressed else IMAGE
        self._received = {output.name: 0 for output in OUTPUTS}
        self._state: dict[str, str] = {}  # of the newest diagnostics
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node('rsmb_player', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        suffix = '/compressed' if compressed else ''
        self.image, self.reference = f'/image{suffix}', f'/reference/image{suffix}'
        self._publish_to = self._publishers()
        self._subscribe()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait_until_ready(self, timeout_s: float) -> None:
        """Wait until the node is compiled, hears us, and we hear every output of it."""
        self._wait_until(lambda: self._process.said('ready: '), 'ready node', timeout_s)
        self._wait_until(lambda: bool(self._state), 'diagnostics')
        self._wait_until(
            lambda: all(p.get_subscription_count() for p in self._publish_to.values()),
            'subscriptions of the node to ' + ', '.join(self._publish_to),
        )

    def give_reference(self, data: bytes) -> None:
        """Publish the reference, a serialised image, latched, and wait until the node has it."""
        self._publish(self.reference, self._kind, data, time.time_ns())
        self._wait_until(lambda: self._state['references received'] != '0', 'reference taken')

    def give_camera_info(self, data: bytes, now_ns: int) -> None:
        """Publish a serialised CameraInfo."""
        self._publish(_CAMERA_INFO_TOPIC, CAMERA_INFO, data, now_ns)

    def play(self, data: bytes, now_ns: int) -> None:
        """Publish a live frame, a serialised image; `now_ns` is its time in the recording."""
        stamp = stamp_ns(deserialize_message(data, _CLASSES[self._kind]).header.stamp)
        self.answers.played[stamp] = time.monotonic()
        self._publish(self.image, self._kind, data, now_ns)

    def spin_until(self, moment_s: float) -> None:
        """Take what comes until ``time.monotonic()`` is `moment_s`."""
        while (left := moment_s - time.monotonic()) > 0:
            self._spin_once(min(left, _POLL_S))

    def wait_for_answers(self, timeout_s: float) -> None:
        """Wait until the node has no frame left and every output of every frame has come."""

        def idle() -> bool:
            if self._state:
                self.answers.counts = self._counts()
            total, *parts = self.answers.counts.values() or (-1,)
            return bool(self._state) and total == sum(parts)

        for _ in range(2):  # what the second one tells was sent after all frames had come
            self._state = {}
            self._wait_until(idle, 'idle node', timeout_s)
        processed = self.answers.counts['processed']
        self._wait_until(
            lambda: all(count == processed for count in self._received.values()),
            f'{processed} messages of each output',
        )
        if not processed:
            raise NodeProblem(f'the node processed no frame; it says {self._said()}')

    # -- endpoints ---------------------------------------------------------------------------

    def _publishers(self) -> dict[str, Any]:
        image = _CLASSES[self._kind]
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node = self._node
        return {
            self.reference: node.create_publisher(image, self.reference, latched),
            self.image: node.create_publisher(image, self.image, 1),
            _CAMERA_INFO_TOPIC: node.create_publisher(CameraInfo, _CAMERA_INFO_TOPIC, 1),
        }

    def _subscribe(self) -> None:
        for output in OUTPUTS:
            self._listen(f'/rsmb/{output.name}', output.type, partial(self._on_output, output.name))
        # The last one: the node hears of the readers in this order, so once it sends
        # diagnostics to us, it knows those of its outputs.
        self._listen('/diagnostics', _DIAGNOSTICS, self._on_diagnostics)

    def _listen(self, topic: str, kind: str, take: Callable[[bytes], None]) -> None:
        """Record a topic as it was on the wire, and hand each message to `take`."""

        def record(data: bytes) -> None:
            self._writer.write_cdr(topic, kind, data, time.time_ns())
            take(data)

        self._node.create_subscription(_CLASSES[kind], topic, record, _QUEUE, raw=True)

    def _publish(self, topic: str, kind: str, data: bytes, now_ns: int) -> None:
        self._writer.write_cdr(topic, kind, data, now_ns, latched=topic == self.reference)
        self._publish_to[topic].publish(data)

    # -- what comes --------------------------------------------------------------------------

    def _on_output(self, name: str, data: bytes) -> None:
        self._received[name] += 1
        if name == 'regions_json':
            summary = json.loads(deserialize_message(data, String).data)
            stamp = summary['stamp']['sec'] * NS_PER_S + summary['stamp']['nanosec']
            self.answers.summaries[stamp] = summary
            self.answers.arrived[stamp] = time.monotonic()

    def _on_diagnostics(self, data: bytes) -> None:
        status = deserialize_message(data, DiagnosticArray).status[0]
        self._state = {pair.key: pair.value for pair in status.values}
        self._state['message'] = status.message

    def _counts(self) -> dict[str, int]:
        """Return what became of the frames, the sum first."""
        names = ('received', 'processed', 'dropped')
        return {name: int(self._state[f'frames {name}']) for name in names}

    def _wait_until(
        self, done: Callable[[], bool], what: str, timeout_s: float = _ANSWER_S
    ) -> None:
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                raise NodeProblem(
                    f'no {what} in {timeout_s:g} s; received {self._received}, '
                    f'the node says {self._said()}'
                )
            self._spin_once(_POLL_S)

    def _spin_once(self, timeout_s: float) -> None:
        self._check()
        self._process.check_alive()
        self._executor.spin_once(timeout_sec=timeout_s)

    def _said(self) -> str:
        return repr(self._state.get('message', 'nothing'))
