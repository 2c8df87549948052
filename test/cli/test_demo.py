"""`rsmb demo`: the real node over real topics, recorded, scored, shown."""

import importlib.util
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

import rsmb_ros
from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.cli.demo import default_bag
from rsmb_ros.cli.demo_report import object_table, read_truth, summary_of
from rsmb_ros.core import Camera, Detector
from rsmb_ros.core.errors import FileProblem
from rsmb_ros.messages.outputs import OUTPUTS
from rsmb_ros.ros.node_process import NodeProblem, NodeProcess

DEMO_S = 420.0  # includes compiling every kernel, twice
needs_ros = pytest.mark.skipif(
    importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed'
)


@pytest.fixture(scope='module')
def environment():
    """Return the environment of a process that finds this package."""
    source = str(Path(rsmb_ros.__file__).parents[1])
    paths = [source, os.environ.get('PYTHONPATH', '')]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, paths))}


@pytest.fixture(scope='module')
def demo(flight_bag, environment, tmp_path_factory):
    """Run the demo once; returns the finished process and its folder."""
    folder = tmp_path_factory.mktemp('demo')
    command = [sys.executable, '-m', 'rsmb_ros.cli.main', 'demo']
    options = ['--bag', str(flight_bag), '-o', str(folder), '--rate', '2']
    done = subprocess.run(
        command + options,
        env=environment,
        capture_output=True,
        text=True,
        timeout=DEMO_S,
        check=False,
    )
    return done, folder


@needs_ros
def test_demo_finds_the_object_in_every_frame_and_nothing_else(demo):
    done, _ = demo
    assert done.returncode == 0, done.stderr
    assert re.search(r'^ +car +2 +2 *$', done.stdout, re.MULTILINE), done.stdout
    assert 'other regions (false alarms): 0, 0.00 per frame' in done.stdout


@needs_ros
def test_demo_tells_frames_rate_and_latency(demo):
    done, _ = demo
    for line in ('frames played: 4', 'frames processed: 4', 'frames registered: 4'):
        assert line in done.stdout
    assert re.search(r'rate: \d+\.\d Hz', done.stdout)
    assert re.search(r'latency .*: p50 \d+ ms, p95 \d+ ms', done.stdout)


@needs_ros
def test_recording_has_what_was_played_and_every_output(demo, flight):
    _, folder = demo
    with Bag(folder / 'demo.mcap') as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
        stamps = [frame.stamp_ns for frame in bag.frames('/image/compressed')]
        truth = read_truth(bag, '/image/compressed')
    assert counts['/reference/image/compressed'] == 1
    assert counts['/diagnostics'] >= 1
    assert {name: counts[name] for name in counts if name.startswith('/rsmb/')} == {
        f'/rsmb/{output.name}': 4 for output in OUTPUTS
    }
    assert stamps == flight.stamps()
    assert list(truth) == stamps
    assert [objects.get('car') for objects in truth.values()] == list(flight.cars)


@needs_ros
def test_node_over_topics_and_detector_give_equal_masks(demo, flight, focal_px):
    _, folder = demo
    detector = Detector(flight.reference, Camera(focal_px))
    with Bag(folder / 'demo.mcap') as bag:
        for name in ('change_mask', 'valid_mask', 'registered'):
            frames = {frame.stamp_ns: frame.image for frame in bag.frames(f'/rsmb/{name}')}
            for stamp, live in zip(flight.stamps(), flight.live, strict=True):
                expected = getattr(detector.detect(live), name)
                np.testing.assert_array_equal(frames[stamp], expected)


@needs_ros
def test_page_and_picture_are_written(demo, flight):
    _, folder = demo
    assert 'rsmb demo' in (folder / 'demo.html').read_text()
    assert 'found: car' in (folder / 'demo.html').read_text()
    rows, cols = cv2.imread(str(folder / 'demo.png')).shape[:2]
    assert rows > flight.reference.shape[0]
    assert cols > 2 * flight.reference.shape[1]  # two by two
    assert 'kernels compiled' in (folder / 'node.log').read_text()


# -- when the node fails -----------------------------------------------------------------------


@pytest.fixture
def start_node(environment, monkeypatch, tmp_path):
    """Start a node with ROS arguments; it is gone when the test is over."""
    pytest.importorskip('rclpy')
    monkeypatch.setenv('PYTHONPATH', environment['PYTHONPATH'])
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    return lambda *arguments: NodeProcess(arguments, tmp_path / 'node.log')


def wait_until(done, timeout_s, what):
    deadline = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < deadline, f'no {what} in {timeout_s} s'
        time.sleep(0.02)


def test_node_that_refuses_its_parameters_is_reported_with_its_reason(start_node, tmp_path):
    with start_node('-p', 'chnage.min_area:=0.1') as node:

        def wait():
            wait_until(node.check_alive, 60.0, 'end of the node')

        with pytest.raises(NodeProblem, match=r'exit code 2; .*chnage\.min_area') as problem:
            wait()
    assert str(tmp_path / 'node.log') in str(problem.value)


def test_node_stops_with_0_and_its_end_is_noticed(start_node, tmp_path):
    with start_node() as node:
        wait_until(lambda: node.said('ready: '), 60.0, 'ready node')
        node.check_alive()
        assert not node.said('never')
        node.stop(15.0)
        with pytest.raises(NodeProblem, match='ended with exit code 0'):
            node.check_alive()
    assert 'ready: ' in (tmp_path / 'node.log').read_text()


@pytest.fixture
def running_demo(flight_bag, environment, tmp_path):
    """Start a slow demo and wait until its node runs; returns process and folder."""
    pytest.importorskip('rclpy')
    command = [sys.executable, '-m', 'rsmb_ros.cli.main', 'demo', '--rate', '0.1']
    options = ['--bag', str(flight_bag), '-o', str(tmp_path)]
    log = tmp_path / 'node.log'
    with subprocess.Popen(
        command + options, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            wait_until(
                lambda: log.exists() and 'kernels compiled' in log.read_text(),
                DEMO_S,
                'compiled node',
            )
            yield process, tmp_path
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30.0)


def children_of(process):
    return Path(f'/proc/{process.pid}/task/{process.pid}/children').read_text().split()


def test_ctrl_c_ends_demo_and_node_and_leaves_a_whole_recording(running_demo):
    process, folder = running_demo
    (node,) = children_of(process)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30.0)
    assert (process.returncode, errors) == (
        130,
        'rsmb: error: interrupted; what was finished is kept\n',
    )
    assert not Path('/proc', node).exists()
    with (folder / 'demo.mcap').open('rb') as stream:
        assert list(make_reader(stream, validate_crcs=True).iter_metadata())


def test_node_that_ends_while_it_is_played_to_is_told(running_demo):
    process, folder = running_demo
    (node,) = children_of(process)
    os.kill(int(node), signal.SIGTERM)
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 1
    assert f'the node ended with exit code 0; see {folder / "node.log"}: ' in errors
    assert (folder / 'demo.mcap').exists()


# -- bad input, told before a node is started ----------------------------------------------------


def test_missing_bag_is_named(rsmb, tmp_path):
    done = rsmb('demo', '--bag', tmp_path / 'gone.mcap', '-o', tmp_path / 'out')
    assert done.code == 1
    assert 'gone.mcap: no such file or folder' in done.err
    assert not (tmp_path / 'out').exists()


def test_two_image_types_are_refused(rsmb, factory, flight, tmp_path):
    path = tmp_path / 'mixed.mcap'
    header = factory.header(1, '')
    png = cv2.imencode('.png', flight.live[0])[1].tobytes()
    with BagWriter(path) as bag:
        bag.write('/reference/image', factory.image(header, flight.reference), 1)
        bag.write('/image/compressed', factory.compressed(header, png, 'png'), 1)
    done = rsmb('demo', '--bag', path, '-o', tmp_path / 'out')
    assert done.code == 1
    assert 'the node takes one type for both' in done.err


@pytest.mark.parametrize('rate', ['0', '-1', 'nan', 'fast'])
def test_impossible_rate_is_wrong_usage(rsmb, rate):
    done = rsmb('demo', f'--rate={rate}')
    assert done.code == 2
    assert '--rate' in done.err


def test_without_ros_the_remedy_is_told(rsmb, flight_bag, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name: None if name == 'rclpy' else find(name)
    )
    done = rsmb('demo', '--bag', flight_bag)
    assert done.code == 1
    assert 'rclpy is not installed: source /opt/ros/jazzy/setup.bash or pip install' in done.err


def test_default_bag_is_looked_for_where_colcon_installs(monkeypatch, tmp_path):
    monkeypatch.setattr('rsmb_ros.cli.demo.__file__', str(tmp_path / 'site' / 'a' / 'b' / 'c.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'usr'))
    prefixes = os.pathsep.join([str(tmp_path / 'ros'), str(tmp_path / 'ws')])
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes)
    with pytest.raises(FileProblem, match=r'demo\.mcap: not found below .*; name a bag with --bag'):
        default_bag()
    bag = tmp_path / 'ws' / 'share' / 'rsmb_ros' / 'bags' / 'demo.mcap'
    bag.parent.mkdir(parents=True)
    bag.touch()
    assert default_bag() == bag


# -- numbers -----------------------------------------------------------------------------------


class Answers:
    """Two frames played, the second one found a car and a ghost; a third was dropped."""

    played = {1: 10.0, 2: 10.2, 3: 10.3}  # noqa: RUF012
    arrived = {1: 10.1, 2: 10.5}  # noqa: RUF012
    counts = {'received': 3, 'processed': 2, 'dropped': 1}  # noqa: RUF012
    summaries = {  # noqa: RUF012
        1: {'status': 'not_registered', 'reason': 'no texture', 'regions': []},
        2: {
            'status': 'registered',
            'reason': '',
            'regions': [
                {'kind': kind, 'bounding_box': {'x': x, 'y': 0, 'width': 20, 'height': 10}}
                for kind, x in (('change', 0), ('change', 100), ('static', 200))
            ],
        },
    }


def test_numbers_are_of_the_frames_that_were_processed():
    truth = {stamp: {'car': (0, 0, 20, 10), 'van': (50, 50, 9, 9)} for stamp in (1, 2, 3)}
    summary = summary_of(Answers, truth)
    assert summary['frames played'] == '3'
    assert summary['frames dropped for a newer one'] == '1'
    assert summary['frames lost before the node'] == '0'
    assert summary['frames registered'] == '1'
    assert summary['rate'] == '4.0 Hz'
    assert summary['latency from played to answered'] == 'p50 200 ms, p95 290 ms'
    assert summary['other regions (false alarms)'] == '1, 0.50 per frame'
    assert object_table(Answers, truth).rows == [('car', '2', '1'), ('van', '2', '0')]


def test_bag_without_truth_has_no_score():
    assert 'other regions (false alarms)' not in summary_of(Answers, {})
    assert object_table(Answers, {}).rows == []
