"""Order of file names as people count."""

from __future__ import annotations

import re
from pathlib import Path


def by_number(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a key that sorts ``live_9`` before ``live_10``; the name itself decides ties."""
    parts = re.split(r'(\d+)', path.name.casefold())
    return [(int(p), '') if p.isdecimal() else (-1, p) for p in parts], path.name
