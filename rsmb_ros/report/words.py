"""Numbers as people read them."""

from __future__ import annotations


def numbers(count: int, noun: str) -> str:
    """Return '1 frame' or '2 frames'."""
    return f'{count:,} {noun}' + ('' if count == 1 else 's')


def percent(share: float) -> str:
    """Return '12 %'; a little more than nothing, or less than all, is never called so."""
    inexact = 0 < share < 0.01 or 0.99 < share < 1
    return f'{min(max(100 * share, 0.1), 99.9):.1f} %' if inexact else f'{100 * share:.0f} %'
