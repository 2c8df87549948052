"""What a blob of the live frame is called in a result."""

from __future__ import annotations

import numpy as np

from .layers import Layer
from .segmentation import Blob
from .types import Region


def change_region(blob: Blob, strength: np.ndarray, threshold_high: float) -> Region:
    """Return what is new in the live frame, from its evidence `strength` (M, N) [sigma]."""
    peak = float(strength[blob.box][blob.mask].max())
    # 0.5 at the threshold, towards 1 as the evidence grows beyond it
    score = 1.0 - 0.5 * (threshold_high / max(peak, 1e-6)) ** 2
    return _region(blob, 'change', float(np.clip(score, 0.0, 1.0)), None)


def static_region(layer: Layer) -> Region:
    """Return what was there at another depth."""
    return _region(layer.blob, 'static', min(1.0, layer.share), layer.place.relative_depth)


def _region(blob: Blob, kind: str, score: float, depth: float | None) -> Region:
    rows, cols = np.nonzero(blob.mask)
    return Region(
        x=blob.x + int(cols.min()),
        y=blob.y + int(rows.min()),
        width=int(cols.max() - cols.min()) + 1,
        height=int(rows.max() - rows.min()) + 1,
        area=blob.area,
        kind=kind,
        score=score,
        relative_depth=depth,
    )
