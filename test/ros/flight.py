"""A node in its own process, a camera in another, and what is seen of both; for load and soak."""

import json
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray, String

from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT
from rsmb_ros.ros.domain import isolated_domain
from rsmb_ros.ros.node_process import NodeProcess
from rsmb_ros.ros.player import stamp_of

FEEDER = Path(__file__).with_name('feeder.py')
READY_S = 240.0  # includes compiling every kernel
ANSWER_S = 60.0
END_S = 30.0
_CLASSES = {IMAGE: Image, ROWS: Float32MultiArray, TEXT: String}
_QUEUE = 100  # messages; a busy listener loses none


class Trouble(Exception):
    """What must not happen in a flight."""


class Camera:
    """The process feeder.py."""

    def __init__(self, sent, *options):
        self._sent = sent
        self.process = subprocess.Popen(
            [sys.executable, str(FEEDER), '--sent', str(sent), *options],
            stdin=subprocess.PIPE,
            text=True,
        )

    def tell(self, command):
        """Give a command."""
        self.process.stdin.write(f'{command}\n')
        self.process.stdin.flush()

    def stop(self):
        """End the stream; return the stamps of the frames that were sent."""
        self.tell('quit')
        if self.process.wait(END_S) != 0:
            raise Trouble(f'the camera ended with {self.process.returncode}')
        return json.loads(self._sent.read_text())

    def close(self):
        """Leave nothing running."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdin.close()


class Listener:
    """Subscribes to every output and to diagnostics; spins in a thread of its own."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self._node = rclpy.create_node('listener', context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self._node)
        self._subscriptions = {}
        self.counts = Counter()  # messages by output
        self.stamps = {output.name: Counter() for output in OUTPUTS}
        self.latencies_s, self.arrivals_s, self.transport_s = [], [], []  # of regions_json, images
        self.states = []  # time, level, message, values of each diagnostics
        for output in OUTPUTS:
            self._subscribe(output)
        # the last one: once the node sends diagnostics to us, it knows our other subscriptions
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._take_state, 10)
        self._ending = False
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def listen(self, output):
        """Subscribe to an output."""
        self._in_spin(lambda: self._subscribe(output))

    def leave(self, output):
        """Unsubscribe from an output."""
        made = self._subscriptions.pop(output.name)
        self._in_spin(lambda: self._node.destroy_subscription(made))

    @contextmanager
    def probe(self):
        """Measure, meanwhile, how long images take from the camera to a process like the node."""
        made = []

        def take(data):
            self.transport_s.append((time.time_ns() - stamp_of(data)) * 1e-9)

        def subscribe():
            made.append(
                self._node.create_subscription(
                    Image, '/image', take, qos_profile_sensor_data, raw=True
                )
            )

        self._in_spin(subscribe)
        yield
        self._in_spin(lambda: self._node.destroy_subscription(made.pop()))

    def _subscribe(self, output):
        def take(data):
            self._take(output, data)

        self._subscriptions[output.name] = self._node.create_subscription(
            _CLASSES[output.type], f'/rsmb/{output.name}', take, _QUEUE, raw=True
        )

    def _in_spin(self, action):
        """Act in the thread that spins: a subscription that it waits for must not go away."""
        done = threading.Event()

        def act():
            action()
            done.set()

        self._executor.create_task(act)
        if not done.wait(ANSWER_S):
            raise Trouble(f'the listener did not act in {ANSWER_S:g} s')

    def _take(self, output, data):
        self.counts[output.name] += 1
        if output.type == ROWS:
            return
        if output.type == TEXT:
            values = json.loads(deserialize_message(data, String).data)['stamp']
            stamp = values['sec'] * 10**9 + values['nanosec']
            self.arrivals_s.append(time.monotonic())
            self.latencies_s.append((time.time_ns() - stamp) * 1e-9)
        else:
            stamp = stamp_of(data)
        self.stamps[output.name][stamp] += 1

    def _take_state(self, msg):
        (status,) = msg.status
        values = {pair.key: pair.value for pair in status.values}
        self.states.append((time.monotonic(), status.level[0], status.message, values))

    def node_counts(self):
        """Return what became of the frames as the node tells it, the sum first."""
        values = self.states[-1][3]
        return {
            name: int(values[f'frames {name}']) for name in ('received', 'processed', 'dropped')
        }

    def idle(self):
        """Return whether the newest diagnostics tell of no frame in work."""
        total, *parts = self.node_counts().values()
        return total == sum(parts)

    def _spin(self):
        while not self._ending:
            self._executor.spin_once(timeout_sec=0.1)

    def close(self):
        """Leave the graph."""
        self._ending = True
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self.context)


class Flight:
    """Node, listener and camera."""

    def __init__(self, node, listener, camera):
        self.node, self.listener, self.camera = node, listener, camera
        self.samples = []  # time, resident memory [MB], threads, open files

    def sample(self):
        """Note what the node holds."""
        root = Path(f'/proc/{self.node.pid}')
        status = dict(line.split(':', 1) for line in (root / 'status').read_text().splitlines())
        files = len(list((root / 'fd').iterdir()))
        memory = int(status['VmRSS'].split()[0]) / 1024
        self.samples.append((time.monotonic(), memory, int(status['Threads']), files))

    def wait_until(self, done, what, timeout_s=ANSWER_S):
        """Wait, sampling once a second, with the node alive."""
        deadline, next_sample = time.monotonic() + timeout_s, 0.0
        while not done():
            now = time.monotonic()
            if now > deadline:
                state = self.listener.states[-1][2:] if self.listener.states else 'nothing'
                raise Trouble(
                    f'no {what} in {timeout_s:g} s; received {dict(self.listener.counts)}, '
                    f'the node says {state}'
                )
            self.node.check_alive()
            if now >= next_sample:
                self.sample()
                next_sample = now + 1.0
            time.sleep(0.02)

    def wait(self, seconds):
        """Let time pass."""
        end = time.monotonic() + seconds
        self.wait_until(lambda: time.monotonic() >= end, '', timeout_s=2 * seconds + 1)

    def wait_until_idle(self):
        """Wait until the node has answered all it has."""
        for _ in range(2):  # what the second one tells was sent after all else had come
            seen = len(self.listener.states)
            self.wait_until(
                lambda seen=seen: len(self.listener.states) > seen and self.listener.idle(),
                'idle node',
            )


@contextmanager
def flight(folder, node_arguments, camera_options):
    """Yield a flight whose node has answered; everything is gone in the end."""
    with isolated_domain(folder), NodeProcess(node_arguments, folder / 'node.log') as node:
        listener = Listener()
        camera = None
        try:
            flight = Flight(node, listener, None)
            flight.wait_until(lambda: node.said('ready: '), 'ready node', READY_S)
            flight.wait_until(lambda: bool(listener.states), 'diagnostics')
            camera = Camera(folder / 'sent.json', *camera_options)
            flight.camera = camera
            flight.wait_until(lambda: bool(listener.counts['regions_json']), 'answer', READY_S)
            flight.samples.clear()
            yield flight
        finally:
            if camera is not None:
                camera.close()
            listener.close()
