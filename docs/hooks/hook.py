"""The hooks of mkdocs: fill in what is generated, write equations as MathML."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from mkdocs.plugins import event_priority
from rsmb_docs.mathml import mathml
from rsmb_docs.pages import filled

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
CELL = re.compile(r'<td\b.*?</td>', re.DOTALL)
NAME = re.compile(r'(?<=<code>)[^<]{12,}(?=</code>)')
JOINT = re.compile(r'(?<=\w)([._/]+)(?=\w{3})')


def on_page_markdown(markdown: str, **others: Any) -> str:
    """Fill in what the page asks for."""
    return filled(markdown)


def on_page_content(content: str, **others: Any) -> str:
    """Replace what pymdownx.arithmatex found."""
    content = BLOCK.sub(
        lambda one: f'<div class="equation">{mathml(html.unescape(one[1]), True)}</div>', content
    )
    content = INLINE.sub(lambda one: mathml(html.unescape(one[1])), content)
    return CELL.sub(lambda one: NAME.sub(_with_joints, one[0]), content)


def _with_joints(name: re.Match[str]) -> str:
    """Let a long name be broken where a reader would break it: a phone's tables are narrow."""
    return JOINT.sub(r'\1<wbr>', name[0])


@event_priority(-100)  # when the search index is written
def on_post_build(config: Any, **others: Any) -> None:
    """Lay the search index beside itself as a script, which a page from the disk may read."""
    index = Path(config['site_dir'], 'search', 'search_index.json')
    index.with_suffix('.js').write_text(f'var __index = {index.read_text("utf-8")}', 'utf-8')
