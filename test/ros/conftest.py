"""The real node in its own process, and a peer that talks to it over DDS."""

import importlib
import os
import re
import socket
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsmb_ros
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS

FIRST_RESULT_S = 240.0  # includes compiling every kernel
ANSWER_S = 30.0
_REPEAT_S = 0.2  # a best-effort message sent before the reader knows the writer is lost
_PORT_BASE = 22119  # as domain_coordinator does: who holds the port holds the domain


@pytest.fixture(scope='session')
def ros_environment(tmp_path_factory):
    """Yield the environment of an isolated ROS domain; it is this process's own too."""
    pytest.importorskip('rclpy', reason='rclpy is not installed: no topics to test')
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # its parser imports sre_parse, deprecated since 3.11
        importlib.import_module('rosidl_generator_py')
    domain, lock = _free_domain()
    with lock, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(domain))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('ros_log')))
        source = str(Path(rsmb_ros.__file__).parents[1])
        patch.setenv('PYTHONPATH', source, prepend=os.pathsep)
        yield os.environ


def _free_domain():
    for domain in range(1, 60):
        lock = socket.socket()
        try:
            lock.bind(('127.0.0.1', _PORT_BASE + domain))
        except OSError:
            lock.close()
        else:
            return domain, lock
    pytest.fail('no free ROS domain among 1 to 59')


class NodeProcess:
    """`rsmb_node` as users start it."""

    def __init__(self, ros_args=(), program=('-m', 'rsmb_ros.ros.main'), **environment):
        command = [sys.executable, *program, '--ros-args', *ros_args]
        self.process = subprocess.Popen(
            command, env={**os.environ, **environment}, stderr=subprocess.PIPE, text=True
        )
        self.log = []
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self.process.stderr:
            with self._changed:
                self.log.append(line.rstrip())
                self._changed.notify_all()

    def wait_for_log(self, pattern, timeout_s):
        """Return once a line matches `pattern`."""

        def found():
            return any(re.search(pattern, line) for line in self.log)

        with self._changed:
            in_time = self._changed.wait_for(found, timeout_s)
        assert in_time, f'no line {pattern!r} in {timeout_s} s; log: {self.log}'

    def send(self, number):
        """Send a signal."""
        self.process.send_signal(number)

    def wait(self, timeout_s):
        """Return the exit code."""
        code = self.process.wait(timeout_s)
        self._reader.join()
        return code

    def close(self):
        """Leave nothing running; a killed node would leave its shared memory behind."""
        self.process.terminate()
        try:
            self.wait(ANSWER_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.wait(ANSWER_S)
            raise
        self.process.stderr.close()


@pytest.fixture(scope='module')
def start_node(ros_environment):
    """Return a function that starts a node; all are gone when the module is done."""
    started = []

    def start(ros_args=(), **options):
        started.append(NodeProcess(ros_args, **options))
        return started[-1]

    yield start
    for node in started:
        node.close()


class Peer:
    """
    Publishes inputs, collects outputs; everything that waits has a deadline.

    With a `namespace` it is the peer of the node there, and hears that one's diagnostics only.
    """

    def __init__(self, only=None, namespace=''):
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image
        from std_msgs.msg import Float32MultiArray, String

        from rsmb_ros.ros.factory import RclpyFactory

        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('peer', context=self.context, namespace=namespace or None)
        self._of_node = f'{namespace}/rsmb:'.lstrip('/') if namespace else ''
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._factory = RclpyFactory()
        self.diagnostics = []
        classes = {IMAGE: Image, ROWS: Float32MultiArray}
        wanted = [output for output in OUTPUTS if only is None or output.name in only]
        self.outputs = {output.name: [] for output in wanted}
        for output in wanted:
            self.node.create_subscription(
                classes.get(output.type, String),
                f'{namespace}/rsmb/{output.name}',
                self.outputs[output.name].append,
                50,
            )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take_state, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.image = self.node.create_publisher(Image, 'image', 1)
        self.compressed = self.node.create_publisher(CompressedImage, 'image/compressed', 1)
        self.camera_info = self.node.create_publisher(CameraInfo, 'camera_info', 1)
        self.reference = self.node.create_publisher(Image, 'reference/image', 1)
        self.depth = self.node.create_publisher(Image, 'reference/depth', 1)
        self.latched_reference = self.node.create_publisher(Image, 'reference/image', latched)

    def _take_state(self, msg):
        if msg.status[0].name.startswith(self._of_node):
            self.diagnostics.append(msg)

    def message(self, array, stamp_ns=0, frame_id=''):
        """Return an Image."""
        from std_msgs.msg import Header

        header = Header(frame_id=frame_id)
        header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        return self._factory.image(header, array)

    def wait_until(self, done, timeout_s, what, repeat=None):
        """
        Spin until ``done()``; fail naming `what` and everything seen.

        `repeat` is called every now and then.
        """
        deadline = time.monotonic() + timeout_s
        next_repeat = 0.0
        while not done():
            now = time.monotonic()
            if now > deadline:
                pytest.fail(f'no {what} in {timeout_s} s; {self._seen()}')
            if repeat is not None and now >= next_repeat:
                repeat()
                next_repeat = now + _REPEAT_S
            self._executor.spin_once(timeout_sec=0.05)

    def _seen(self):
        topics = sorted(name for name, _ in self.node.get_topic_names_and_types())
        counts = {name: len(messages) for name, messages in self.outputs.items()}
        state = self.state() if self.diagnostics else 'none'
        return f'topics: {topics}; received: {counts}; last diagnostics: {state}'

    def state(self):
        """Return level, message and values of the last diagnostics."""
        status = self.diagnostics[-1].status[0]
        values = {pair.key: pair.value for pair in status.values}
        return {'level': status.level[0], 'message': status.message, **values}

    def call(self, kind, name, request, timeout_s=ANSWER_S):
        """Call a service and return its answer."""
        client = self.node.create_client(kind, name)
        self.wait_until(client.service_is_ready, timeout_s, f'service {name}')
        future = client.call_async(request)
        self.wait_until(future.done, timeout_s, f'answer of {name}')
        self.node.destroy_client(client)
        return future.result()

    def set_parameter(self, name, value):
        """Set one parameter, as `ros2 param set` does; return the answer."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return self.call(SetParameters, '/rsmb/set_parameters', request).results[0]

    def wait_for_state(self, accept, timeout_s, what, repeat=None):
        """Return the first state from now on that `accept` takes."""
        self.diagnostics.clear()
        self.wait_until(lambda: self.diagnostics and accept(self.state()), timeout_s, what, repeat)
        return self.state()

    def give_reference(self, array):
        """Publish a reference to the volatile readers until the node reports a new one."""
        before = self.wait_for_state(lambda _: True, ANSWER_S, 'diagnostics')
        self.wait_for_state(
            lambda state: state['references received'] > before['references received'],
            ANSWER_S,
            'reference taken',
            repeat=lambda: self.reference.publish(self.message(array)),
        )

    def results_of(self, send, stamp_ns, names=None, timeout_s=FIRST_RESULT_S):
        """Call `send` until each output in `names` came for `stamp_ns`; return them by name."""
        names = self.outputs.keys() if names is None else names
        for name in names:
            self.outputs[name].clear()
        stamped = [name for name in names if name != 'row_motion']

        def found(name):
            return next((m for m in self.outputs[name] if _stamp_ns_of(m) == stamp_ns), None)

        self.wait_until(
            lambda: (
                all(found(name) for name in stamped)
                and ('row_motion' not in names or self.outputs['row_motion'])
            ),
            timeout_s,
            f'outputs {sorted(names)} with stamp {stamp_ns}',
            repeat=send,
        )
        results = {name: found(name) for name in stamped}
        if 'row_motion' in names:
            results['row_motion'] = self.outputs['row_motion'][-1]
        return results

    def close(self):
        """Take the peer off the graph."""
        import rclpy

        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def _stamp_ns_of(message):
    """Return the stamp of an image, or the one inside the JSON of a String."""
    import json

    if hasattr(message, 'header'):
        return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    stamp = json.loads(message.data)['stamp']
    return stamp['sec'] * 1_000_000_000 + stamp['nanosec']


@pytest.fixture(scope='module')
def start_peer(ros_environment):
    """Return a function that starts a peer; it subscribes to all outputs or those named."""
    started = []

    def start(only=None, namespace=''):
        started.append(Peer(only, namespace))
        return started[-1]

    yield start
    for peer in started:
        peer.close()


class Scene:
    """A textured plane, 160 x 120 px, seen 5 px to the right, with one object that appeared."""

    shape = (120, 160)
    box = (slice(40, 64), slice(90, 118))  # of the object in the live frame

    def __init__(self):
        rng = np.random.default_rng(20170303)
        noise = cv2.GaussianBlur(rng.normal(size=(140, 200)), (0, 0), 2.0)
        ground = 128 + 45 * noise / noise.std()
        rows, cols = self.shape
        self.reference = self._photo(ground[10 : 10 + rows, 15 : 15 + cols], rng)
        self.unchanged = self._photo(ground[10 : 10 + rows, 20 : 20 + cols], rng)
        self.live = self.unchanged.copy()
        texture = rng.integers(0, 2, (6, 7)) * 235.0 + 10
        self.live[self.box] = cv2.resize(texture, (28, 24), interpolation=cv2.INTER_NEAREST)

    @staticmethod
    def _photo(ground, rng):
        return np.clip(ground + rng.normal(0, 1.5, ground.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope='session')
def scene():
    """Return the one scene of the topic tests."""
    return Scene()
