"""What only the source text of a module tells: comments beside fields, names in calls."""

from __future__ import annotations

import ast
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[3] / 'rsmb_ros'


def field_comments(kind: type) -> dict[str, str]:
    """Return the comment beside each annotated field of a class, '' where there is none."""
    source = textwrap.dedent(inspect.getsource(kind))
    comments = {
        token.start[0]: token.string.lstrip('# ')
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    return {
        node.target.id: comments.get(node.lineno, '')
        for node in body.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }


def readable(comment: str, nothing: str = 'None') -> str:
    """Return a comment as Markdown: texts of the code as code, `nothing` for None."""
    text = comment.replace("''", 'empty')
    return re.sub(r"'(\w+)'", r'`\1`', text).replace('None', nothing)


def tree(path: str) -> ast.Module:
    """Parse a module; `path` is relative to the package."""
    return ast.parse((PACKAGE / path).read_text('utf-8'))


def calls(path: str, name: str) -> Iterator[list[str]]:
    """Yield the positional arguments, as source, of each call of `name` in a module."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Call):
            called = node.func
            own = called.attr if isinstance(called, ast.Attribute) else getattr(called, 'id', '')
            if own == name:
                yield [_text(argument) for argument in node.args]


def constant(path: str, name: str) -> str:
    """
    Return the text that a module gives to `name`.

    Raises
    ------
    KeyError
        If it does not.

    """
    for node in tree(path).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return str(ast.literal_eval(node.value))
    raise KeyError(f'{path} has no constant {name}: mend docs/hooks/rsmb_docs')


def template(node: ast.expr) -> str:
    """Return a text or f-string with '...' for what is filled in; '' if it is neither."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return ''.join(
            str(part.value) if isinstance(part, ast.Constant) else '...' for part in node.values
        )
    return ''


def _text(node: ast.expr) -> str:
    return str(node.value) if isinstance(node, ast.Constant) else ast.unparse(node)
