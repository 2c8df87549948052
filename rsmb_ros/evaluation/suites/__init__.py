"""Named, seeded suites of cases with truth."""

from __future__ import annotations

from collections.abc import Mapping

from .real import photos_suite, video_suite
from .simulated import SIMULATED
from .suite import NUISANCES, Suite, Wish

SUITES: Mapping[str, Suite] = {
    suite.name: suite for suite in (*SIMULATED, photos_suite(), video_suite())
}

__all__ = ['NUISANCES', 'SUITES', 'Suite', 'Wish']
