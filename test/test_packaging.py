"""What pip, colcon and rosdep are told is true."""

from __future__ import annotations

import ast
import os
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

import rsmb_ros

setuptools = pytest.importorskip('setuptools')

ROOT = Path(__file__).parents[1]
ROS = {
    'ament_index_python',
    'diagnostic_msgs',
    'launch',
    'launch_ros',
    'rcl_interfaces',
    'rclpy',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
}
NO_WHEEL = {'launch', 'launch_ros'}
WITH_RCLPY = {'rcl_interfaces'}
ROS_IF_PRESENT = {'vision_msgs'}
IF_PRESENT = {'osqp': 'osqp', 'distributed': 'batch'}  # -> its extra: rosdep has no key for it
# imported name -> (distribution on PyPI, rosdep key). The keys are those of rosdistro's
# rosdep/python.yaml of 2025: all but mcap's and rosbags' (by pip) are apt packages of Ubuntu 24.04.
LIBRARIES = {
    'cv2': ('opencv-python-headless', 'python3-opencv'),
    'jinja2': ('jinja2', 'python3-jinja2'),
    'lz4': ('lz4', 'mcap-ros2-support'),  # comes with mcap
    'mcap': ('mcap', 'mcap-ros2-support'),
    'numba': ('numba', 'python3-numba'),
    'numpy': ('numpy', 'python3-numpy'),
    'rich': ('rich', 'python3-rich'),
    'rosbags': ('rosbags', 'python3-rosbags-pip'),
    'scipy': ('scipy', 'python3-scipy'),
    'skimage': ('scikit-image', 'python3-skimage'),
    'sklearn': ('scikit-learn', 'python3-sklearn'),
    'threadpoolctl': ('threadpoolctl', 'python3-sklearn'),
    'yaml': ('pyyaml', 'python3-yaml'),
    'zstandard': ('zstandard', 'mcap-ros2-support'),  # comes with mcap
}


@pytest.fixture(scope='module')
def build():
    """Arguments that setup.py gives to setuptools."""
    arguments = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, 'setup', lambda **given: arguments.update(given))
        runpy.run_path('setup.py')
    return arguments


@pytest.fixture(scope='module')
def manifest():
    """Root element of package.xml."""
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def third_party() -> set[str]:
    """Top-level names of everything imported that is neither ours nor Python's."""
    names: set[str] = set()
    for path in [*(ROOT / 'rsmb_ros').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names.update(alias.name.split('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.split('.')[0])
    return names - set(sys.stdlib_module_names) - {'rsmb_ros'}


def test_name_and_version_are_the_same_everywhere(build, manifest):
    assert build['version'] == rsmb_ros.__version__ == manifest.findtext('version')
    assert build['name'] == 'rsmb_ros' == manifest.findtext('name')


def test_every_installed_file_exists(build):
    for target, files in build['data_files']:
        assert files, f'nothing goes to {target}'
        for name in files:
            assert (ROOT / name).is_file(), f'{name} for {target} is missing'
            assert '__pycache__' not in name


def test_launch_file_configuration_and_index_entry_are_installed(build):
    installed = {
        f'{target}/{Path(name).name}' for target, files in build['data_files'] for name in files
    }
    assert {
        'share/ament_index/resource_index/packages/rsmb_ros',
        'share/rsmb_ros/package.xml',
        'share/rsmb_ros/launch/rsmb.launch.py',
        'share/rsmb_ros/config/rsmb.yaml',
        'lib/rsmb_ros/rsmb',
        'lib/rsmb_ros/rsmb_node',
    } <= installed


def test_every_file_beside_the_code_is_package_data(build):
    packed = {
        path
        for package, patterns in build['package_data'].items()
        for pattern in patterns
        for path in (ROOT / package.replace('.', '/')).glob(pattern)
    }
    folder = ROOT / 'rsmb_ros'
    beside = {p for p in folder.rglob('*') if p.is_file() and '__pycache__' not in p.parts}
    assert {path for path in beside if path.suffix != '.py'} == packed


def test_every_folder_of_code_is_a_package(build):
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / 'rsmb_ros').rglob('*.py')}
    assert {'.'.join(folder.parts) for folder in folders} == set(build['packages'])


def test_every_library_imported_is_declared_to_pip_and_rosdep(build, manifest):
    required = {re.match('[a-z0-9-]+', entry)[0] for entry in build['install_requires']}
    depends = {element.text for element in manifest.iter('exec_depend')}
    used = third_party() - ROS - ROS_IF_PRESENT - set(IF_PRESENT)
    for name, extra in IF_PRESENT.items():
        (entry,) = build['extras_require'][extra]
        assert re.match('[a-z]+', entry)[0] == name
        assert entry in build['extras_require']['test']
    assert used <= set(LIBRARIES), 'add the new ones here, to setup.py and to package.xml'
    assert required == {LIBRARIES[name][0] for name in used}
    assert depends - ROS == {LIBRARIES[name][1] for name in used}


def test_every_ros_package_imported_is_declared_to_pip_and_rosdep(build, manifest):
    depends = {element.text for element in manifest.iter('exec_depend')}
    wheels = {re.match('[a-z-]+', entry)[0] for entry in build['extras_require']['ros']}
    used = third_party() & ROS
    assert used == depends & ROS
    assert wheels == {f'ros-jazzy-{n.replace("_", "-")}' for n in used - NO_WHEEL - WITH_RCLPY}


@pytest.mark.parametrize('name', ['rsmb', 'rsmb_node'])
def test_wrapper_starts_what_the_console_script_starts(build, name):
    wrapper = ROOT / 'scripts' / name
    (target,) = (
        line.split(' = ')[1]
        for line in build['entry_points']['console_scripts']
        if line.startswith(f'{name} = ')
    )
    module = target.split(':')[0]
    assert os.access(wrapper, os.X_OK)
    assert f'-m {module} ' in wrapper.read_text()
    assert f'/bin/{name}"' in wrapper.read_text()
