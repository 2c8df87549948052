"""Markdown that every generator writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; cells are Markdown on one line."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join('| ' + ' | '.join(map(_cell, line)) + ' |' for line in lines) + '\n'


def code(text: object) -> str:
    """Return inline code."""
    return f'`{text}`'


def fenced(text: str, language: str = 'text') -> str:
    """Return a block of code."""
    return f'```{language}\n{text.rstrip()}\n```\n'


def described(names: Iterable[str], texts: Mapping[str, str], where: str) -> dict[str, str]:
    """
    Return the text of each name.

    Raises
    ------
    KeyError
        If the code has a name without text, or a text has lost its name: a list that was true once.

    """
    names = list(names)
    missing = [name for name in names if name not in texts]
    stale = [name for name in texts if name not in names]
    if missing or stale:
        raise KeyError(
            f'{where}: no text for {missing or "none"}, text for {stale or "none"} that the code '
            'does not know; mend the table there'
        )
    return {name: texts[name] for name in names}


def _cell(text: str) -> str:
    """Return one line in which no bar outside inline code ends the cell."""
    parts = ' '.join(str(text).split()).split('`')
    parts[::2] = (part.replace('|', r'\|') for part in parts[::2])
    return '`'.join(parts)
