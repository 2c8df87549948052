"""Plays images to a running node and records what it answers, over real topics."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float32MultiArray, String

from rsmb_ros.bags.reading import CAMERA_INFO, COMPRESSED
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT
from rsmb_ros.messages.stamps import NS_PER_S

from .node_process import NodeProblem, NodeProcess
from .player import CLASSES, Player, stamp_of

_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_CLASSES = {
    **CLASSES,
    ROWS: Float32MultiArray,
    TEXT: String,
    _DIAGNOSTICS: DiagnosticArray,
}
_CAMERA_INFO_TOPIC = '/camera_info'
_ANSWER_S = 30.0  # for what a healthy node does at once, on a busy machine
_QUEUE = 100  # messages; everything published is to be recorded


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
        self._process = process
        self._writer = writer
        self._kind = COMPRESSED if compressed else IMAGE
        self._received = {output.name: 0 for output in OUTPUTS}
        self._state: dict[str, str] = {}  # of the newest diagnostics
        suffix = '/compressed' if compressed else ''
        self.image, self.reference = f'/image{suffix}', f'/reference/image{suffix}'
        self._topics = {
            self.reference: self._kind,
            self.image: self._kind,
            _CAMERA_INFO_TOPIC: CAMERA_INFO,
        }

        def still_good() -> None:
            check()
            process.check_alive()

        self._player = Player(self._topics, {self.reference}, still_good)
        self._subscribe()

    def close(self) -> None:
        """Leave the graph."""
        self._player.close()

    def wait_until_ready(self, timeout_s: float) -> None:
        """Wait until the node is compiled, hears us, and we hear every output of it."""
        self._wait_until(lambda: self._process.said('ready: '), 'ready node', timeout_s)
        self._wait_until(lambda: bool(self._state), 'diagnostics')
        self._wait_until(
            lambda: all(map(self._player.listeners, self._topics)),
            'subscriptions of the node to ' + ', '.join(self._topics),
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
        self.answers.played[stamp_of(data)] = time.monotonic()
        self._publish(self.image, self._kind, data, now_ns)

    def spin_until(self, moment_s: float) -> None:
        """Take what comes until ``time.monotonic()`` is `moment_s`."""
        self._player.spin_until(moment_s)

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

        self._player.node.create_subscription(_CLASSES[kind], topic, record, _QUEUE, raw=True)

    def _publish(self, topic: str, kind: str, data: bytes, now_ns: int) -> None:
        self._writer.write_cdr(topic, kind, data, now_ns, latched=topic == self.reference)
        self._player.publish(topic, data)

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
            self._player.spin_once()

    def _said(self) -> str:
        return repr(self._state.get('message', 'nothing'))
