"""What of a settled frame is reported as changed: cut to what is sure, parted, named."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from .change_finder import Finding
from .config import ChangeConfig
from .depth_rims import depth_rims
from .misplaced import misplaced
from .parting import parted
from .regions import change_region, in_shade
from .segmentation import Blob, blobs, drawn, tightened, without_small, without_thin, without_weak
from .shadows import shadow_like
from .types import Region
from .workers import Workers, each


@dataclass(frozen=True)
class Change:
    """One object that is new, or gone, in the live frame."""

    blob: Blob
    region: Region


def changes_of(finding: Finding, config: ChangeConfig, executor: Workers) -> list[Change]:
    """
    Return the changes of a frame, top to bottom; threads of `executor` look at one each.

    What is left of a candidate when static objects, unknown pixels and the width of the evidence's
    window are cut away must still be large enough and reach `threshold_high` by itself. Rims of
    static objects and what only lies a little off are no changes: they are marked as not judged.
    Parts of one region that hardly hang together are changes of their own.
    """
    frame, seen = finding.frame, finding.seen
    mask = without_small(without_thin(seen.mask * frame.judged), config)
    if config.segmentation == 'evidence':
        mask = without_small(tightened(mask, seen.sharp, seen.outline), config)
        mask = without_weak(mask, seen.strength, config)
    rims = depth_rims(mask, finding.layers)
    frame.judged &= rims == 0
    part = partial(parted, seen=seen, judged=frame.judged, config=config)
    parts = [one for found in each(executor, part, blobs(mask & (1 - rims))) for one in found]
    decided = each(executor, partial(_decided, finding=finding, config=config), parts)
    for blob, (_, known) in zip(parts, decided, strict=True):
        if not known:
            frame.judged[blob.box] &= ~blob.mask
    return [change for change, _ in decided if change is not None]


def _decided(blob: Blob, finding: Finding, config: ChangeConfig) -> tuple[Change | None, bool]:
    """Return the change that a part is, if it is one, and whether that can be known."""
    frame, seen = finding.frame, finding.seen
    region = change_region(blob, seen.strength, frame.judged)
    if region.score < config.min_score:
        return None, True
    if shadow_like(blob, finding, config.threshold_high):
        reported = config.shadows == 'report'
        return Change(blob, in_shade(region)) if reported else None, True
    if misplaced(blob, frame):
        return None, False
    return Change(blob, region), True


def mask_of(changes: list[Change], shape: tuple[int, ...]) -> np.ndarray:
    """Draw changes into an empty mask of `shape` (M, N), uint8 0/1."""
    return drawn([change.blob for change in changes], shape)
