"""The Python API: everything `rsmb_ros.core` exports, from signatures, comments and docstrings."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator
from functools import cached_property
from typing import Any

from rsmb_ros import core

from .numpydoc import Docstring
from .sources import field_comments, readable
from .tables import code, fenced, table

ORDER = ('Detector', 'Result', 'Region', 'Camera', 'Config', 'warm_up')  # others follow


def api_sections() -> str:
    """Return one section for each class and function, then exceptions, then constants."""
    named = {name: getattr(core, name) for name in core.__all__}
    errors = {n: v for n, v in named.items() if inspect.isclass(v) and issubclass(v, Exception)}
    callables = [n for n, v in named.items() if callable(v) and n not in errors]
    first = [name for name in ORDER if name in callables]
    rest = [name for name in callables if name not in first]
    parts = [_section(name, named[name]) for name in (*first, *rest)]
    parts += ['## Exceptions', _errors(errors)]
    constants = {n: v for n, v in named.items() if not callable(v)}
    rows = [(code(name), code(value)) for name, value in constants.items()]
    parts += ['## Constants', table(('name', 'value'), rows)]
    return '\n\n'.join(parts)


def _section(name: str, thing: Any) -> str:
    parts = [
        f'## {name}',
        fenced(_signature(name, thing), 'python'),
        Docstring.of(thing).markdown(),
    ]
    if inspect.isclass(thing):
        parts += [_fields(thing), *_methods(thing)]
    return '\n\n'.join(part for part in parts if part)


def _signature(name: str, thing: Any) -> str:
    head = 'class ' if inspect.isclass(thing) else ''
    if thing in (core.Result, core.Region):
        return f'{head}{name}'  # made by the detector; the fields follow
    if thing is core.Config:
        return f'{head}{name}()'  # its groups have a page of their own
    signature = inspect.signature(thing)
    text = f'{head}{name}{_readable(signature)}'
    if len(text) <= 88:
        return text
    inside = ',\n    '.join(_parameter(one) for one in signature.parameters.values())
    end = '' if inspect.isclass(thing) else _returns(signature)
    return f'{head}{name}(\n    {inside},\n){end}'


def _readable(signature: inspect.Signature) -> str:
    inside = ', '.join(_parameter(one) for one in signature.parameters.values())
    return f'({inside}){_returns(signature)}'


def _parameter(one: inspect.Parameter) -> str:
    kind = '' if one.annotation is one.empty else f': {_annotation(one.annotation)}'
    if one.default is one.empty:
        return f'{one.name}{kind}'
    default = (
        f'{type(one.default).__name__}()'
        if dataclasses.is_dataclass(one.default)
        else (
            '...'
            if type(one.default).__name__ == '_HAS_DEFAULT_FACTORY_CLASS'
            else repr(one.default)
        )
    )
    return f'{one.name}{kind} = {default}'


def _returns(signature: inspect.Signature) -> str:
    kind = signature.return_annotation
    return '' if kind is signature.empty or kind in (None, 'None') else f' -> {_annotation(kind)}'


def _annotation(kind: Any) -> str:
    return kind if isinstance(kind, str) else getattr(kind, '__name__', str(kind))


def _fields(kind: type) -> str:
    if not dataclasses.is_dataclass(kind):
        return ''
    if kind is core.Config:
        return 'Its groups and their fields: [Parameters](parameters.md).'
    comments = field_comments(kind)
    rows = [
        (code(field.name), code(_annotation(field.type)), readable(comments[field.name]))
        for field in dataclasses.fields(kind)
        if field.repr
    ]
    return table(('field', 'type', 'meaning'), rows)


def _methods(kind: type) -> Iterator[str]:
    for name, value in vars(kind).items():
        if name.startswith('_'):
            continue
        if isinstance(value, property | cached_property):
            getter = value.fget if isinstance(value, property) else value.func
            returns = _returns(inspect.signature(getter))
            yield f'### {kind.__name__}.{name}\n'
            yield fenced(f'{name}{returns.replace(" ->", ":")}', 'python')
            yield Docstring.of(getter).markdown()
        elif isinstance(value, classmethod | staticmethod) or inspect.isfunction(value):
            bound = getattr(kind, name)
            signature = inspect.signature(bound)
            own = [one for one in signature.parameters.values() if one.name != 'self']
            yield f'### {kind.__name__}.{name}\n'
            yield fenced(f'{name}{_readable(signature.replace(parameters=own))}', 'python')
            yield Docstring.of(bound).markdown()


def _errors(errors: dict[str, type]) -> str:
    rows = [
        (code(name), code(kind.__base__.__name__), inspect.getdoc(kind) or '')
        for name, kind in sorted(errors.items(), key=lambda one: len(one[1].__mro__))
        if kind.__base__
    ]
    return table(('exception', 'is a', 'means'), rows)
