"""Options that verbs share: the configuration from a file and from the command line."""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from rsmb_ros.core.config import Config, flatten
from rsmb_ros.core.errors import ConfigError, FileProblem, RsmbError

# Parameters of the node that say nothing about the method.
_NODE_ONLY = ('image_transport', 'autostart', 'use_sim_time', 'qos_overrides')
_NODE = 'rsmb'
_PARAMETERS = 'ros__parameters'


class _Loader(yaml.SafeLoader):
    """Reads 1e-4 as a number, as the node does; YAML 1.1 wants 1.0e-4."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?[0-9]+[eE][-+]?[0-9]+$'), list('-+0123456789')
)


def add_config_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--config`` and ``--set``."""
    parser.add_argument(
        '--config',
        type=Path,
        metavar='FILE.yaml',
        help='parameters; the same file the node takes, only what differs is needed',
    )
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='SECTION.KEY=VALUE',
        help='one parameter; wins over --config; repeatable',
    )


def mcap_path(text: str) -> Path:
    """Return an output bag's path, for argparse."""
    if not text.endswith('.mcap'):
        raise argparse.ArgumentTypeError(f'{text!r} must end in .mcap')
    return Path(text)


def frame_size(text: str) -> tuple[int, int]:
    """Parse COLSxROWS into (rows, cols), for argparse."""
    found = re.fullmatch(r'(\d+)x(\d+)', text)
    cols, rows = (int(group) for group in found.groups()) if found else (0, 0)
    if not (240 <= rows <= 4320 and 320 <= cols <= 7680):
        raise argparse.ArgumentTypeError(f'{text!r} must be COLSxROWS, 320x240 to 7680x4320')
    return rows, cols


def frame_rate(text: str) -> float:
    """Return frames per second, for argparse."""
    rate = float(text)
    if not 0 < rate <= 1000:
        raise argparse.ArgumentTypeError(f'{text} Hz must be above 0 and at most 1000')
    return rate


def require_ros() -> None:
    """Raise `RsmbError` where there is no rclpy."""
    if importlib.util.find_spec('rclpy') is None:
        raise RsmbError(
            'rclpy is not installed: source /opt/ros/jazzy/setup.bash '
            'or pip install "rsmb_ros[ros]"'
        )


def within(kind: type, low: float, high: float) -> Callable[[str], Any]:
    """Return an argparse type for numbers from `low` to `high`."""

    def parse(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f'{text!r} must be a number from {low} to {high}')
        return value

    return parse


def data_folder(given: Path | None) -> Path | None:
    """Return the folder with real pictures: as given, else RSMB_DATA, else None."""
    if given is None and os.environ.get('RSMB_DATA'):
        return Path(os.environ['RSMB_DATA'])
    return given


def load_config(args: argparse.Namespace) -> Config:
    """
    Return the configuration that `args` ask for.

    Raises
    ------
    FileProblem
        If the file cannot be read.
    ConfigError
        If it is no YAML, or a key or value is not allowed.

    """
    config = Config()
    if args.config is not None:
        try:
            config = config.replaced(_read(args.config))
        except ConfigError as error:
            raise ConfigError(f'{args.config}: {error}') from error
    return config.replaced(dict(_assignment(text) for text in args.set))


def _read(path: Path) -> dict[str, Any]:
    """Return the parameters of the method in `path`, with dotted names."""
    try:
        content = parse_yaml(path.read_text('utf-8'))
    except OSError as error:
        raise FileProblem(f'{path}: cannot be read: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError('not YAML: ' + ' '.join(str(error).split())) from error
    if content is None:
        return {}
    if not isinstance(content, Mapping):
        raise ConfigError(f'holds a {type(content).__name__}, must hold sections of parameters')
    values = flatten(_without_node_names(content))
    return {name: value for name, value in values.items() if name.split('.')[0] not in _NODE_ONLY}


def _without_node_names(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Take off ``/**: ros__parameters:``; a file without it holds the sections themselves."""
    nodes = dict(_nodes(content))
    if not nodes:
        return content
    merged: dict[str, Any] = {}
    for name, values in nodes.items():
        if name.split('/')[-1] in (_NODE, '*', '**'):
            merged.update(flatten(values or {}))
    if not merged and not any(name.split('/')[-1] == _NODE for name in nodes):
        raise ConfigError(f'holds parameters of {", ".join(nodes)} only; must name /** or {_NODE}')
    return merged


def _nodes(content: Mapping[str, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Iterate over full node names and their parameters; namespaces may be nested."""
    for key, value in content.items():
        name = f'{above}/{str(key).strip("/")}'
        if isinstance(value, Mapping):
            if _PARAMETERS in value:
                yield name, value[_PARAMETERS]
            else:
                yield from _nodes(value, name)


def parse_yaml(text: str) -> Any:
    """Return what a text of YAML says, numbers as the node reads them; raises `yaml.YAMLError`."""
    return yaml.load(text, _Loader)


def _assignment(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition('=')
    if not equals:
        raise ConfigError(f'--set {text!r} must be SECTION.KEY=VALUE')
    try:
        return name.strip(), parse_yaml(value)
    except yaml.YAMLError as error:
        raise ConfigError(f'--set {text!r}: the value is not YAML') from error
