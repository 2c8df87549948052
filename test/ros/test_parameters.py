"""Parameters: the YAML file says what the code says, wrong ones end the node with 2."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from rsmb_ros.core.config import Config, flatten, parameters

SETTINGS = Path(__file__).parents[2] / 'config' / 'rsmb.yaml'
READY_S, ANSWER_S = 240.0, 60.0


@pytest.fixture(scope='module')
def in_yaml():
    """Return the shipped values, flat, in the order of the file."""
    return flatten(yaml.safe_load(SETTINGS.read_text())['/**']['ros__parameters'])


def test_yaml_has_every_parameter_in_the_order_of_the_code_with_its_default(in_yaml):
    assert list(in_yaml.items()) == [
        *Config().flat().items(),
        ('image_transport', 'raw'),
        ('autostart', True),
    ]


def test_yaml_explains_every_parameter_in_the_words_of_the_code():
    comments = [
        line.strip() for line in SETTINGS.read_text().splitlines() if line.startswith('      #')
    ]
    assert comments == [f'# {p.doc} [{p.allowed()}]' for p in parameters()]


def run_node(*ros_args):
    """Run a node that is expected to end by itself; return exit code and stderr."""
    command = [sys.executable, '-m', 'rsmb_ros.ros.main', '--ros-args', *ros_args]
    done = subprocess.run(
        command, env=os.environ, capture_output=True, text=True, timeout=ANSWER_S, check=False
    )
    return done.returncode, done.stderr


REFUSED = {
    'misspelt': ('change.treshold_low:=2.0', ['change.treshold_low', 'change.threshold_low']),
    'out of range': ('shutter.exposure_rows:=-3.5', ['-3.5', '0 to 5000 rows']),
    'wrong type': ('layers.enabled:=7', ['layers.enabled = 7', 'true or false']),
    'not a choice': ('shutter.readout:=sideways', ['sideways', 'top_down, bottom_up']),
    'contradiction': (
        'change.threshold_low:=8',
        ['change.threshold_low', 'must be below change.threshold_high'],
    ),
    'transport': ('image_transport:=zip', ['image_transport', 'raw, compressed']),
    'qos': ('qos_overrides./image.subscription.depth:=few', ['/image', "'few'", 'whole number']),
    'qos of an output': (
        'qos_overrides./rsmb/overlay.publisher.reliability:=good',
        ['/rsmb/overlay', "'good'", 'reliable, best_effort'],
    ),
    'autostart': ('autostart:=maybe', ['autostart', 'true or false']),
}


@pytest.mark.parametrize(('override', 'says'), REFUSED.values(), ids=REFUSED)
def test_wrong_parameter_ends_the_node_with_2_and_one_line(ros_environment, override, says):
    code, stderr = run_node('-p', override)
    assert code == 2, stderr
    (line,) = stderr.splitlines()
    assert line.startswith('rsmb_node: ')
    for text in says:
        assert text in line


def test_wrong_yaml_ends_the_node_with_2(ros_environment, tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('rsmb:\n  ros__parameters:\n    shutter: {exposure_row: 3.0}\n')
    code, stderr = run_node('--params-file', str(file))
    assert code == 2
    assert "'shutter.exposure_row' is unknown" in stderr
    code, stderr = run_node('--params-file', str(tmp_path / 'none.yaml'))
    assert code == 2
    assert 'none.yaml' in stderr


@pytest.mark.parametrize('name', ['rsmb', 'nadir', 'forward'])
def test_shipped_yaml_and_whole_numbers_are_accepted(start_node, name):
    file = SETTINGS.with_name(f'{name}.yaml')
    node = start_node(
        [
            *['--params-file', str(file), '-p', 'shutter.exposure_rows:=40'],
            *['-p', 'use_sim_time:=true', '-p', 'qos_overrides./image.subscription.depth:=2'],
        ]
    )
    node.wait_for_log('ready: ', READY_S)


def test_descriptors_tell_meaning_unit_and_range():
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    from rsmb_ros.ros.parameters import AUTOSTART, IMAGE_TRANSPORT, describe

    described = {p.name: describe(p) for p in (*parameters(), IMAGE_TRANSPORT, AUTOSTART)}
    exposure = described['shutter.exposure_rows']
    assert '[0 to 5000 rows]' in exposure.description
    (bounds,) = exposure.floating_point_range
    assert (bounds.from_value, bounds.to_value) == (0.0, 5000.0)
    (limits,) = described['worker.threads'].integer_range
    assert (limits.from_value, limits.to_value) == (1, 64)
    assert 'bottom_up' in described['shutter.readout'].additional_constraints
    assert described['image_transport'].read_only
    assert described['autostart'].read_only
    assert not exposure.read_only
