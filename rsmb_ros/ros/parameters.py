"""Parameters of the node: those of `Config` and `image_transport`, checked by one code."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import rclpy.parameter
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from rsmb_ros.core.config import Config, Parameter, parameters
from rsmb_ros.core.errors import ConfigError

if TYPE_CHECKING:
    from rclpy.node import Node

IMAGE_TRANSPORT = Parameter(
    name='image_transport',
    default='raw',
    unit='-',
    doc='raw: image and reference/image; compressed: image/compressed and the like',
    choices=('raw', 'compressed'),
)
# The endpoints exist from the start, so what shapes them cannot change later.
_FIXED_AT_START = (IMAGE_TRANSPORT.name, 'publish.queue_depth')

# Declared and checked by rclpy itself.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')
_OF_RCLPY_PREFIX = 'qos_overrides.'


def declare(node: Node) -> tuple[Config, str]:
    """
    Declare every parameter with the value the user gave, or its default.

    Parameters
    ----------
    node : Node
        Created with ``automatically_declare_parameters_from_overrides=True``: what the user gave
        is declared already, which is how a misspelt name comes to light.

    Returns
    -------
    config : Config
    image_transport : str

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
    transport = IMAGE_TRANSPORT.check(given.pop(IMAGE_TRANSPORT.name, IMAGE_TRANSPORT.default))
    config = Config().replaced(given)
    for parameter in (*parameters(), IMAGE_TRANSPORT):
        if node.has_parameter(parameter.name):
            node.set_descriptor(parameter.name, describe(parameter))
        else:
            node.declare_parameter(parameter.name, parameter.default, describe(parameter))
    return config, transport


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
        if change.name.startswith(_OF_RCLPY_PREFIX):
            raise ConfigError(f'{change.name} is fixed at the start: restart the node with it')
        if change.name not in (*_OF_RCLPY, IMAGE_TRANSPORT.name):
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


def _is_of_rclpy(name: str) -> bool:
    return name in _OF_RCLPY or name.startswith(_OF_RCLPY_PREFIX)
