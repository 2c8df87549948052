"""Docstrings in numpy's format, taken apart and written as Markdown."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass

SECTION = re.compile(r'^(\w[\w ]*)\n-{3,}\n', re.MULTILINE)
ENTRIES = ('Parameters', 'Attributes', 'Returns', 'Yields', 'Raises')


@dataclass(frozen=True)
class Docstring:
    """A docstring without its indentation."""

    text: str  # summary and what follows it
    sections: tuple[tuple[str, str], ...]  # title, body

    @classmethod
    def of(cls, thing: object) -> Docstring:
        """Read the docstring of a class or function; empty where there is none."""
        text = inspect.getdoc(thing) or ''
        parts = SECTION.split(text)
        pairs = zip(parts[1::2], parts[2::2], strict=True)
        return cls(parts[0].strip(), tuple((title, body.strip()) for title, body in pairs))

    def markdown(self) -> str:
        """Return everything as Markdown."""
        parts = [as_code(self.text)]
        for title, body in self.sections:
            if title in ENTRIES:
                items = '\n'.join(_item(name, kind, about) for name, kind, about in entries(body))
                parts.append(f'**{title}**\n\n{items}')
            else:
                parts.append(f'**{title}**\n\n{as_code(body)}')
        return '\n\n'.join(part for part in parts if part.strip())


def entries(body: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and description of each entry of a section; the type may be empty."""
    head: str | None = None
    about: list[str] = []
    for line in [*body.splitlines(), 'end']:
        if line and not line[0].isspace():
            if head is not None:
                name, _, kind = head.partition(' : ')
                yield name.strip(), kind.strip(), inspect.cleandoc('\n'.join(about))
            head, about = line, []
        else:
            about.append(line)


def as_code(text: str) -> str:
    """Return prose with numpy's ``double`` ticks as single ones and figures indented as code."""
    return text.replace('``', '`')


def _item(name: str, kind: str, about: str) -> str:
    head = f'`{name}`' + (f' : {kind}' if kind else '')
    about = ' '.join(as_code(about).split())
    return f'- {head}' + (f'<br>{about}' if about else '')
