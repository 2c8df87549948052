"""Every parameter: of the method from `core.config`, of the node from `ros.parameters`."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable
from itertools import groupby
from typing import cast

from rsmb_ros.core.config import Config, Parameter, parameters
from rsmb_ros.ros.parameters import OF_THE_NODE, describe

from .tables import code, table

TYPES = {float: 'double', int: 'integer', bool: 'bool', str: 'string'}  # as ROS names them
HEAD = ('parameter', 'default', 'allowed', 'meaning')


def parameter_tables() -> str:
    """Return one table for each group, in the order of the code."""
    meanings = {
        section.name: inspect.cleandoc(cast(type, section.default_factory).__doc__ or '')
        for section in dataclasses.fields(Config)
    }
    parts = []
    for group, members in groupby(parameters(), key=lambda one: one.name.split('.')[0]):
        parts += [f'## {group}', meanings[group], _table(members)]
    parts += [
        '## Of the node only',
        '`rsmb` leaves these out when it reads the same file.',
        _table(OF_THE_NODE),
    ]
    return '\n\n'.join(parts)


def rules() -> str:
    """Return what must hold between parameters, as the code refuses it."""
    return '\n'.join(f'- {reason}' for reason in _refusals())


def _table(members: Iterable[Parameter]) -> str:
    return table(HEAD, (_row(one) for one in members))


def _row(one: Parameter) -> tuple[str, ...]:
    about = f'{TYPES[type(one.default)]}, {"fixed" if describe(one).read_only else "at run time"}'
    return (
        f'<a id="{one.name}"></a>{code(one.name)}<br><small>{about}</small>',
        code(str(one.default).lower() if isinstance(one.default, bool) else one.default),
        one.allowed(),
        one.doc,
    )


def _refusals() -> list[str]:
    """Ask the configuration itself: each of these mappings must be refused."""
    from rsmb_ros.core.errors import ConfigError

    asked: tuple[dict[str, object], ...] = (
        {'change.threshold_low': 5.0},
        {'change.persistence_seen': 2},
        {'registration.estimator': 'rows', 'registration.degrees_of_freedom': 4},
    )
    reasons = []
    for mapping in asked:
        try:
            Config.from_mapping(mapping)
        except ConfigError as error:
            reasons.append(f'`{error}`')
        else:
            raise ValueError(f'{mapping} is allowed now: mend docs/hooks/rsmb_docs/parameters.py')
    return reasons
