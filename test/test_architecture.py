"""The house rules that no single module can break unseen."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import yaml

from rsmb_ros.core.config import Config, parameters

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'rsmb_ros'
CORE = sorted((PACKAGE / 'core').rglob('*.py'))
INNER = {
    'core': set(),
    'messages': {'core', 'report'},
    'report': {'core'},
    'evaluation': {'core', 'report'},
    'bags': {'core', 'messages'},
    'replay': {'core', 'messages', 'report', 'bags'},
    'batch': {'core', 'bags', 'replay'},
}
FILES_AND_ROS = ('rclpy', 'rosbags', 'mcap', 'pathlib', 'shutil', 'argparse', 'yaml', 'os')


def imported(path: Path) -> set[str]:
    """Absolute module names a file imports, at any depth."""
    names: set[str] = set()
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            names.add('.'.join([*base, *([node.module] if node.module else [])]))
    return names


def test_core_knows_neither_ros_nor_files():
    for path in CORE:
        for name in imported(path):
            assert name.split('.')[0] not in FILES_AND_ROS, f'{path} imports {name}'
            assert not name.endswith('_msgs') and '_msgs.' not in name, f'{path} imports {name}'
            if name.startswith('rsmb_ros'):
                assert name.startswith('rsmb_ros.core'), f'{path} imports {name}'


def test_core_runs_where_there_is_no_ros():
    code = (
        'import sys\n'
        'for name in ("rclpy", "sensor_msgs", "rosbags", "mcap"): sys.modules[name] = None\n'
        'import rsmb_ros.core\n'
    )
    subprocess.run([sys.executable, '-c', code], check=True, timeout=120)


def test_imports_point_inward():
    for part, allowed in INNER.items():
        for path in sorted((PACKAGE / part).rglob('*.py')):
            for name in imported(path):
                if name.startswith('rsmb_ros.'):
                    target = name.split('.')[1]
                    assert target == part or target in allowed, f'{path} imports {name}'


def test_kernels_live_in_one_place():
    for path in sorted(PACKAGE.rglob('*.py')):
        uses = any(name.split('.')[0] == 'numba' for name in imported(path))
        assert not uses or path.parent.name == '_kernels', f'{path} imports numba'


def test_yaml_keys_are_the_fields_of_the_configuration():
    text = (ROOT / 'config' / 'rsmb.yaml').read_text()
    (node,) = yaml.safe_load(text).values()
    values = node['ros__parameters']
    known = {parameter.name for parameter in parameters()}
    written = {
        f'{section}.{key}'
        for section, entries in values.items()
        if isinstance(entries, dict)
        for key in entries
    }
    assert written == known
    sections = {key: entries for key, entries in values.items() if isinstance(entries, dict)}
    assert Config.from_mapping(sections) == Config()
