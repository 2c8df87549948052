"""Parameters of the node: those of `Config` and a few of its own, checked by one code."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import rclpy.parameter
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from rsmb_ros.core.config import Config, Parameter, parameters
from rsmb_ros.core.errors import ConfigError

from .endpoints import check_qos_override

if TYPE_CHECKING:
    from rclpy.node import Node

IMAGE_TRANSPORT = Parameter(
    name='image_transport',
    default='raw',
    unit='-',
    doc='raw: image and reference/image; compressed: image/compressed and the like',
    choices=('raw', 'compressed'),
)
AUTOSTART = Parameter(
    name='autostart',
    default=True,
    unit='-',
    doc='configure and activate by itself; false: wait for ~/change_state',
)
OF_THE_NODE = (IMAGE_TRANSPORT, AUTOSTART)
# What shapes endpoints, or acts at the start only, cannot change later.
_FIXED_AT_START = (*(parameter.name for parameter in OF_THE_NODE), 'publish.queue_depth')

# Declared and checked by rclpy itself.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')
_OF_RCLPY_PREFIX = 'qos_overrides.'


@dataclass(frozen=True)
class Settings:
    """What the user asked for."""

    config: Config
    image_transport: str
    autostart: bool


def declare(node: Node) -> Settings:
    """
    Declare every parameter with the value the user gave, or its default.

    Parameters
    ----------
    node : Node
        Created with ``automatically_declare_parameters_from_overrides=True``: what the user gave
        is declared already, which is how a misspelt name comes to light.

    Raises
    ------
    ConfigError
        If a name is unknown or a value not allowed.

    """
    given = {
        name: node.get_parameter(name).value
        for name in node.get_parameters_by_prefix('')
        if not _is_of_rclpy(name)
    }
    own = {p.name: p.check(given.pop(p.name, p.default)) for p in OF_THE_NODE}
    config = Config().replaced(given)
    for parameter in (*parameters(), *OF_THE_NODE):
        if node.has_parameter(parameter.name):
            node.set_descriptor(parameter.name, describe(parameter))
        else:
            node.declare_parameter(parameter.name, parameter.default, describe(parameter))
    return Settings(config, **own)


def check_qos_overrides(node: Node, topics: Collection[str]) -> None:
    """
    Refuse QoS overrides of `topics` that no endpoint could be created with.

    Endpoints come and go with the node's state; a wrong setting has to be told at the start.

    Raises
    ------
    ConfigError
        If a policy cannot be overridden or its value is not allowed.

    """
    for name in node.get_parameters_by_prefix('qos_overrides'):
        topic, *_, policy = name.split('.')  # /image.subscription.depth
        if topic in topics:
            value = node.get_parameter(f'{_OF_RCLPY_PREFIX}{name}').value
            check_qos_override(topic, policy, value)


def changed(config: Config, changes: Iterable[rclpy.parameter.Parameter]) -> Config:
    """
    Return `config` with changes made at run time; those that rclpy checks itself are left out.

    Raises
    ------
    ConfigError
        If a name is unknown, a value not allowed, or a QoS override comes too late.

    """
    ours = {}
    for change in changes:
        if is_of_qos(change.name):
            raise ConfigError(f'{change.name} is fixed at the start: restart the node with it')
        if change.name not in (*_OF_RCLPY, *(parameter.name for parameter in OF_THE_NODE)):
            ours[change.name] = change.value
    return config.replaced(ours)


def describe(parameter: Parameter) -> ParameterDescriptor:
    """Return what tools show of a parameter: meaning, unit and range."""
    descriptor = ParameterDescriptor(
        description=f'{parameter.doc} [{parameter.allowed()}]',
        read_only=parameter.name in _FIXED_AT_START,
        # 40 for 40.0 is no mistake; the type is checked by `Config`.
        dynamic_typing=True,
    )
    if parameter.choices:
        descriptor.additional_constraints = parameter.allowed()
    elif isinstance(parameter.default, float):
        bounds = FloatingPointRange(from_value=parameter.low, to_value=parameter.high)
        descriptor.floating_point_range = [bounds]
    elif not isinstance(parameter.default, bool):
        limits = IntegerRange(from_value=parameter.low, to_value=parameter.high)
        descriptor.integer_range = [limits]
    return descriptor


def is_of_qos(name: str) -> bool:
    """Return whether `name` overrides the QoS of an endpoint."""
    return name.startswith(_OF_RCLPY_PREFIX)


def _is_of_rclpy(name: str) -> bool:
    return name in _OF_RCLPY or is_of_qos(name)
