"""What of a settled frame is reported as changed: cut to what is sure, parted, named."""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class Change:
    """One object that is new, or gone, in the live frame."""

    blob: Blob
    region: Region


def changes_of(finding: Finding, config: ChangeConfig) -> list[Change]:
    """
    Return the changes of a frame, top to bottom.

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
    changes = []
    for blob in [
        part
        for whole in blobs(mask & (1 - rims))
        for part in parted(whole, seen, frame.judged, config)
    ]:
        region = change_region(blob, seen.strength, frame.judged)
        if region.score < config.min_score:
            continue
        if shadow_like(blob, finding, config.threshold_high):
            if config.shadows == 'report':
                changes.append(Change(blob, in_shade(region)))
        elif misplaced(blob, frame):
            frame.judged[blob.box] &= ~blob.mask
        else:
            changes.append(Change(blob, region))
    return changes


def mask_of(changes: list[Change], shape: tuple[int, ...]) -> np.ndarray:
    """Draw changes into an empty mask of `shape` (M, N), uint8 0/1."""
    return drawn([change.blob for change in changes], shape)
