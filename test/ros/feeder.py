"""
A camera for load.py and soak.py: publishes a reference, then frames until told to end.

    python test/ros/feeder.py --size 640x480 --hz 60 --sent SENT.json

Takes commands on stdin, one a line: `malformed`, `size`, `reference`, `clock SECONDS`, `quit`.
On `quit`, or when stdin ends, the stamps of all good frames are written to SENT.json.
"""

import argparse
import itertools
import json
import os
import queue
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np

MARGIN = 24  # px the camera may wander
VIEWS = 16
SHRUNK = (1.0, 0.75, 0.9)  # of the frame's height and width, in turn
LISTENER_S = 30.0
APART_S = 0.05  # between malformed messages: the node keeps the newest one
IMAGE, REFERENCE = '/image', '/reference/image'


def views(rows, cols):
    """Return what is seen: the reference, then frames of a camera that wanders in a circle."""
    rng = np.random.default_rng(20170304)
    noise = rng.normal(size=(rows + 2 * MARGIN, cols + 2 * MARGIN))
    noise = cv2.GaussianBlur(noise, (0, 0), 2.0)
    grey = 128 + 45 * noise / noise.std()
    tint = np.array([0.9, 1.0, 1.05])
    ground = np.clip(grey[..., np.newaxis] * tint, 0, 255).astype(np.uint8)
    angles = np.linspace(0, 2 * np.pi, VIEWS - 1, endpoint=False)
    offsets = [(0, 0), *zip(np.rint(8 * np.sin(angles)), np.rint(8 * np.cos(angles)), strict=True)]
    for y, x in offsets:
        top, left = MARGIN + int(y), MARGIN + int(x)
        yield np.ascontiguousarray(ground[top : top + rows, left : left + cols])


class Feeder:
    """Publishes; every frame with the time as its stamp, and as /clock where that is wanted."""

    def __init__(self, size, with_clock):
        from rclpy.serialization import serialize_message
        from rosgraph_msgs.msg import Clock
        from std_msgs.msg import Header

        from rsmb_ros.messages.outputs import IMAGE as TYPE
        from rsmb_ros.ros.factory import RclpyFactory
        from rsmb_ros.ros.player import Player, restamped

        self._restamped, self._clock_message = restamped, Clock
        self._player = Player({IMAGE: TYPE, REFERENCE: TYPE}, {REFERENCE}, lambda: None)
        self._clock = None
        if with_clock:
            self._clock = self._player.node.create_publisher(Clock, '/clock', 1)
        cols, rows = size
        seen = list(views(rows, cols))
        factory = RclpyFactory()

        def serialised(image):
            header = Header(frame_id='camera')
            return serialize_message(factory.image(header, np.ascontiguousarray(image)))

        self._frames = [
            [
                serialised(image[: round(share * rows), : round(share * cols)])
                for image in (seen if share == 1.0 or with_clock else seen[:1])
            ]
            for share in SHRUNK
        ]
        self._references = itertools.cycle([frames[0] for frames in self._frames])
        self._sizes = itertools.cycle(self._frames)
        self._present = next(self._sizes)
        self._offset_ns = 0
        self.sent = []

    def wait_for_listeners(self):
        """Wait until somebody takes images and references."""
        deadline = time.monotonic() + LISTENER_S
        while not (self._player.listeners(IMAGE) and self._player.listeners(REFERENCE)):
            if time.monotonic() > deadline:
                sys.exit(f'feeder: nobody listens to {IMAGE} and {REFERENCE} in {LISTENER_S:g} s')
            self._player.spin_once()

    def reference(self):
        """Publish the next reference."""
        self._player.publish(REFERENCE, next(self._references))

    def size(self):
        """Change the size of the frames."""
        self._present = next(self._sizes)

    def clock(self, seconds):
        """Let the clock jump."""
        self._offset_ns += round(float(seconds) * 1e9)

    def frame(self, index):
        """Publish a frame."""
        now_ns = time.time_ns() + self._offset_ns
        if self._clock is not None:
            msg = self._clock_message()
            msg.clock.sec, msg.clock.nanosec = divmod(now_ns, 10**9)
            self._clock.publish(msg)
        self.sent.append(now_ns)
        data = self._present[1 + index % (len(self._present) - 1)]
        self._player.publish(IMAGE, self._restamped(data, now_ns))

    def malformed(self):
        """Publish what contradicts itself, as image and as reference."""
        from rclpy.event_handler import PublisherEventCallbacks
        from sensor_msgs.msg import Image

        wrong = [
            {'height': 0, 'width': 0, 'encoding': 'mono8'},
            {'height': 4, 'width': 4, 'encoding': 'mono7', 'step': 4},
            {'height': 4, 'width': 4, 'encoding': 'bgr8', 'step': 4},
            {'height': 4, 'width': 4, 'encoding': 'mono8', 'step': 4},
            {'height': 65535, 'width': 65535, 'encoding': 'bgr8', 'step': 65535 * 3},
        ]
        node = self._player.node
        quiet = PublisherEventCallbacks(
            use_default_callbacks=False
        )  # a latched reader does not match
        publishers = [
            node.create_publisher(Image, topic, 10, event_callbacks=quiet)
            for topic in (IMAGE, REFERENCE)
        ]
        deadline = time.monotonic() + LISTENER_S
        while not all(made.get_subscription_count() for made in publishers):
            if time.monotonic() > deadline:
                sys.exit('feeder: nobody listens to malformed images')
            self._player.spin_once()
        for fields, made in itertools.product(wrong, publishers):
            made.publish(Image(**fields))
            self._player.spin_until(time.monotonic() + APART_S)
        for made in publishers:
            node.destroy_publisher(made)

    def close(self):
        """Leave the graph."""
        self._player.close()


def feed(feeder, hz, commands):
    """Publish at a rate until told to quit."""
    feeder.wait_for_listeners()
    feeder.reference()
    due = time.monotonic()
    for index in itertools.count():
        while not commands.empty():
            name, *arguments = commands.get().split()
            if name == 'quit':
                return
            getattr(feeder, name)(*arguments)
        feeder.frame(index)
        # what could not be sent in time is not caught up on
        due = max(due + 1 / hz, time.monotonic() - 1 / hz)
        time.sleep(max(due - time.monotonic(), 0))


def read_commands(commands):
    """Pass lines of stdin on; its end is the command to quit."""
    for line in sys.stdin:
        commands.put(line.strip())
    commands.put('quit')


def main():
    """Parse, feed, tell what was sent."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--size', default='640x480')
    parser.add_argument('--hz', type=float, default=30.0)
    parser.add_argument('--clock', action='store_true', help='publish /clock')
    parser.add_argument('--sent', type=Path, required=True)
    options = parser.parse_args()

    from rsmb_ros.ros.transport import apply_profile

    apply_profile(os.environ, Path.cwd())
    commands = queue.Queue()
    threading.Thread(target=read_commands, args=[commands], daemon=True).start()
    feeder = Feeder([int(n) for n in options.size.split('x')], options.clock)
    try:
        feed(feeder, options.hz, commands)
    finally:
        feeder.close()
    options.sent.write_text(json.dumps(feeder.sent))
    return 0


if __name__ == '__main__':
    sys.exit(main())
