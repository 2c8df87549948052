"""
Stream images to a running node `rsmb` and check that no output of a processed frame is lost.

    python test/ros/stream_client.py --seconds 30 --hz 10

Publishes a reference and a stream of `image`, subscribes to every output, and compares what arrives
with the count of processed frames in /diagnostics. Prints rates and latency. Exit code: 0 nothing
lost, 1 something lost or no answer.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, Header, String

from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS
from rsmb_ros.messages.stamps import stamp_ns
from rsmb_ros.ros.factory import RclpyFactory
from rsmb_ros.ros.transport import apply_profile

CLASSES = {IMAGE: Image, ROWS: Float32MultiArray}
FIRST_ANSWER_S = 240.0  # includes compiling every kernel
QUIET_S = 20.0
MARGIN = 24  # px the camera may wander
REFERENCE = np.random.default_rng(20170304)


class Silence(Exception):
    """The node did not do in time what was waited for."""


class StreamClient:
    """Sends the stream and counts what comes back, by output."""

    def __init__(self, rows, cols):
        self.node = rclpy.create_node('stream_client')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._factory = RclpyFactory()
        noise = REFERENCE.normal(size=(rows + 2 * MARGIN, cols + 2 * MARGIN))
        noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
        self._ground = np.clip(128 + 45 * noise / noise.std(), 0, 255).astype(np.uint8)
        self._shape = rows, cols
        self.sent = set()  # stamps [ns]
        self.received = {output.name: 0 for output in OUTPUTS}
        self.latencies_ms = []
        self.state = {}
        for output in OUTPUTS:
            self.node.create_subscription(
                CLASSES.get(output.type, String),
                f'/rsmb/{output.name}',
                lambda msg, name=output.name: self._take(name, msg),
                50,
            )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._reference = self.node.create_publisher(Image, 'reference/image', latched)
        self._image = self.node.create_publisher(Image, 'image', 1)

    def _take(self, name, msg):
        """Count; what has a stamp only if it is of a frame in `sent`: a straggler is no answer."""
        if isinstance(msg, Image):
            stamp = stamp_ns(msg.header.stamp)
        elif isinstance(msg, String):
            values = json.loads(msg.data)['stamp']
            stamp = values['sec'] * 10**9 + values['nanosec']
        else:
            self.received[name] += 1
            return
        if stamp in self.sent:
            self.received[name] += 1
            now = self.node.get_clock().now().nanoseconds
            self.latencies_ms.append((now - stamp) * 1e-6)

    def _on_diagnostics(self, msg):
        self.state = {pair.key: pair.value for pair in msg.status[0].values}

    def counts(self):
        """Return what became of the frames, from the last diagnostics."""
        names = ('received', 'processed', 'dropped')
        return {name: int(self.state.get(f'frames {name}', 0)) for name in names}

    def publish_reference(self):
        """Publish the middle of the ground, latched."""
        self._reference.publish(self._factory.image(Header(), self._view(0, 0)))

    def publish_image(self, index):
        """Publish the ground as a camera that wanders in a circle sees it, stamped now."""
        angle = 0.2 * index
        x, y = np.rint(8 * np.array([np.cos(angle), np.sin(angle)])).astype(int)
        header = Header(frame_id='camera')
        header.stamp = self.node.get_clock().now().to_msg()
        self.sent.add(stamp_ns(header.stamp))
        self._image.publish(self._factory.image(header, self._view(y, x)))

    def _view(self, dy, dx):
        rows, cols = self._shape
        view = self._ground[MARGIN + dy : MARGIN + dy + rows, MARGIN + dx : MARGIN + dx + cols]
        return np.ascontiguousarray(view)

    def spin_until(self, done, timeout_s, what):
        """Handle messages until ``done()``; raise `Silence` naming `what` after the time."""
        deadline = time.monotonic() + timeout_s
        while not done():
            if time.monotonic() > deadline:
                raise Silence(
                    f'no {what} in {timeout_s:g} s; received {self.received}, '
                    f'state {self.state or "none"}'
                )
            self._executor.spin_once(timeout_sec=0.02)

    def spin_for(self, seconds):
        """Handle messages for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def wait_until_quiet(self):
        """Wait until the node has no frame in work and says so."""

        def quiet():
            total, *parts = self.counts().values()
            return bool(self.state) and total == sum(parts)

        for _ in range(2):  # the second one was sent after everything else had come
            self.state = {}
            self.spin_until(quiet, QUIET_S, 'idle node')


def stream(client, seconds, hz):
    """Stream, print what was measured and return what was lost, in words."""
    client.publish_reference()
    start = time.monotonic()
    while not all(client.received.values()):  # also discovers every output
        client.publish_image(0)
        client.spin_for(0.2)
        if time.monotonic() - start > FIRST_ANSWER_S:
            raise Silence(f'outputs missing after {FIRST_ANSWER_S:g} s: {client.received}')
    client.wait_until_quiet()
    before = client.counts()
    client.received = dict.fromkeys(client.received, 0)
    client.sent.clear()
    client.latencies_ms.clear()

    start = time.monotonic()
    sent = round(seconds * hz)
    for index in range(sent):
        client.publish_image(index)
        client.spin_for(start + (index + 1) / hz - time.monotonic())
    took = time.monotonic() - start
    client.wait_until_quiet()

    counts = {name: count - before[name] for name, count in client.counts().items()}
    print(f'sent {sent} in {took:.1f} s ({sent / took:.1f} Hz); node: {counts}')
    if not counts['processed']:
        return ['no frame was processed']
    complete = dict.fromkeys(client.received, counts['processed'])
    client.spin_until(lambda: client.received == complete, QUIET_S, f'full set {complete}')
    print(f'output {counts["processed"] / took:.2f} Hz', end='; ')
    p50, p95 = np.percentile(client.latencies_ms, [50, 95])
    print(f'latency stamp to client p50 {p50:.0f} ms, p95 {p95:.0f} ms')
    return []


def main():
    """Parse, stream, report."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--seconds', type=float, default=30.0)
    parser.add_argument('--hz', type=float, default=10.0)
    parser.add_argument('--width', type=int, default=640)
    parser.add_argument('--height', type=int, default=480)
    options = parser.parse_args()
    apply_profile(os.environ, Path.cwd())
    rclpy.init()
    try:
        losses = stream(StreamClient(options.height, options.width), options.seconds, options.hz)
    except Silence as error:
        losses = [str(error)]
    finally:
        rclpy.try_shutdown()
    for loss in losses:
        print(f'lost: {loss}', file=sys.stderr)
    return 1 if losses else 0


if __name__ == '__main__':
    sys.exit(main())
