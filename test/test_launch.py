"""The launch file, run against stand-ins for ROS' launch, which has no wheels."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

from rsmb_ros.core.config import Config, flatten

ROOT = Path(__file__).parents[1]


def module(name, **content):
    made = ModuleType(name)
    vars(made).update(content)
    return made


class Recorded:
    """Keeps what it was made with."""

    def __init__(self, *arguments, **options):
        self.arguments, self.options = arguments, options


class Configuration(Recorded):
    def perform(self, context):
        return context[self.arguments[0]]


@pytest.fixture
def launch_file(monkeypatch):
    """Return the module of the launch file."""
    made = {
        'DeclareLaunchArgument': type('Argument', (Recorded,), {}),
        'OpaqueFunction': type('Function', (Recorded,), {}),
    }
    modules = [
        module('launch', LaunchDescription=Recorded, LaunchContext=dict),
        module('launch.actions', **made),
        module('launch.substitutions', LaunchConfiguration=Configuration),
        module('launch_ros'),
        module('launch_ros.actions', Node=type('Node', (Recorded,), {})),
        module('ament_index_python'),
        module('ament_index_python.packages', get_package_share_directory=lambda _: str(ROOT)),
    ]
    for stand_in in modules:
        monkeypatch.setitem(sys.modules, stand_in.__name__, stand_in)
    spec = importlib.util.spec_from_file_location('rsmb_launch', ROOT / 'launch/rsmb.launch.py')
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.fixture
def launched(launch_file):
    """Return a function that launches with arguments: declared ones, and the node's options."""

    def launch(**given):
        *declared, function = launch_file.generate_launch_description().arguments[0]
        arguments = {one.arguments[0]: one.options for one in declared}
        assert not given.keys() - arguments.keys()
        context = {name: options['default_value'] for name, options in arguments.items()} | given
        (node,) = function.options['function'](context)
        return SimpleNamespace(arguments=arguments, **node.options)

    return launch


def test_node_is_started_with_the_shipped_parameters_and_its_own_topics(launched):
    node = launched()
    assert (node.package, node.executable, node.name) == ('rsmb_ros', 'rsmb_node', 'rsmb')
    (file,) = node.parameters
    assert Path(file).samefile(ROOT / 'config' / 'rsmb.yaml')
    assert dict(node.remappings) == {
        topic: topic for topic in ('image', 'reference/image', 'reference/depth', 'camera_info')
    }
    assert node.respawn is False


def test_arguments_reach_the_node(launched):
    node = launched(
        image='/cam/image_raw',
        reference='/map/tile',
        params_file='my.yaml',
        namespace='drone',
        use_sim_time='True',
        image_transport='compressed',
        log_level='debug',
        respawn='true',
    )
    assert dict(node.remappings)['image'] == '/cam/image_raw'
    assert dict(node.remappings)['reference/image'] == '/map/tile'
    assert node.parameters == [
        'my.yaml',
        {'use_sim_time': True, 'image_transport': 'compressed'},
    ]
    assert (node.namespace, node.respawn) == ('drone', True)
    assert node.ros_arguments == ['--log-level', 'debug']


def test_neither_true_nor_false_is_refused(launched):
    with pytest.raises(ValueError, match='autostart:=maybe must be true or false'):
        launched(autostart='maybe')


def test_every_argument_is_described_and_in_the_readme(launched):
    readme = (ROOT / 'README.md').read_text()
    for name, options in launched().arguments.items():
        assert options['description']
        assert f'`{name}`' in readme, f'{name} is not in the README'


@pytest.mark.parametrize('path', sorted((ROOT / 'config').glob('*.yaml')), ids=lambda p: p.stem)
def test_every_shipped_file_of_parameters_is_accepted_and_lists_what_differs(path):
    (node,) = yaml.safe_load(path.read_text()).values()
    values = flatten(node['ros__parameters'])
    if path.stem == 'rsmb':
        values = {name: value for name, value in values.items() if '.' in name}
        assert Config.from_mapping(values) == Config()
    else:
        assert Config.from_mapping(values) != Config()
