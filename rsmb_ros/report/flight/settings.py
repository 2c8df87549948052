"""The configuration as tables: what somebody changed first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rsmb_ros.core.config import Config, parameters


@dataclass(frozen=True)
class Setting:
    """One parameter in words."""

    name: str
    value: str
    default: str
    unit: str  # '' where it has none
    doc: str
    changed: bool


def settings(config: Config) -> Sequence[Setting]:
    """Return every parameter, in the order of the groups."""
    values = config.flat()
    return [
        Setting(
            one.name,
            _text(values[one.name]),
            _text(one.default),
            '' if one.unit == '-' else one.unit,
            one.doc,
            values[one.name] != one.default,
        )
        for one in parameters()
    ]


def _text(value: object) -> str:
    """Return a value as YAML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:g}' if isinstance(value, float) else str(value)
