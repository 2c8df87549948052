"""The command line, from the parsers that read it."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
from collections.abc import Iterator
from functools import partial

from rsmb_ros.cli import main

from .tables import code, fenced, table

COLOUR = re.compile(r'\x1b\[[\d;]*m')
WIDTH = 88  # columns of a usage line, whatever terminal the site is built in


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield each verb with its arguments."""
    for verb, summary in main.VERBS.items():
        parser = argparse.ArgumentParser(
            prog=f'rsmb {verb}',
            description=f'{summary[0].upper()}{summary[1:]}.',
            formatter_class=partial(argparse.HelpFormatter, width=WIDTH),
        )
        importlib.import_module(f'rsmb_ros.cli.{verb}').add_arguments(parser)
        yield verb, parser


def verb_table() -> str:
    """Return the verbs with a link to each."""
    rows = [(f'[`rsmb {verb}`](#rsmb-{verb})', text) for verb, text in main.VERBS.items()]
    return table(('command', 'does'), rows)


def command_sections() -> str:
    """Return one section a verb: usage and a table of what it takes."""
    return '\n\n'.join(_section(verb, parser) for verb, parser in parsers())


def exit_codes() -> str:
    """Return what the entry point says of its exit codes."""
    text = inspect.getdoc(main.main) or ''
    return ' '.join(text.split('int\n')[1].split())


def _section(verb: str, parser: argparse.ArgumentParser) -> str:
    parts = [f'## rsmb {verb}', parser.description or '', fenced(_usage(parser))]
    for title, actions in _groups(parser):
        if title:
            parts.append(f'**{title[0].upper()}{title[1:]}**')
        parts.append(table(('argument', 'default', 'meaning'), map(_row, actions)))
    if parser.epilog:
        parts.append(parser.epilog)
    return '\n\n'.join(parts)


def _groups(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Yield title and arguments of each group, '' for those without a name of their own."""
    plain, named = [], []
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.dest != 'help']
        if group.title in ('positional arguments', 'options'):
            plain += actions
        elif actions:
            named.append((group.title or '', actions))
    yield '', plain
    yield from named


def _usage(parser: argparse.ArgumentParser) -> str:
    lead = 'usage: '
    plain = COLOUR.sub('', parser.format_usage())  # Python 3.14 colours it in a terminal
    return plain.removeprefix(lead).replace('\n' + ' ' * len(lead), '\n')


def _row(action: argparse.Action) -> tuple[str, str, str]:
    value = '' if action.nargs == 0 else _value(action)
    names = ', '.join(action.option_strings)
    shown = f'{names} {value}'.strip() if names else value
    text = action.help or ''
    if action.choices and action.metavar is not None:
        text += f' ({", ".join(map(str, action.choices))})' if len(list(action.choices)) < 8 else ''
    return code(shown), _default(action), text % {'default': action.default} if text else ''


def _value(action: argparse.Action) -> str:
    if action.metavar is not None:
        return str(action.metavar)
    if action.choices:
        return '{' + ','.join(map(str, action.choices)) + '}'
    return (action.dest if not action.option_strings else action.dest.upper()).upper()


def _default(action: argparse.Action) -> str:
    if action.required:
        return 'required'
    empty = action.default in (None, [], argparse.SUPPRESS) or action.default is False
    if empty:
        return ''
    value = action.default
    return code(','.join(map(str, value)) if isinstance(value, list | tuple) else value)
