"""The depth a scene has at each pixel of its reference."""

from __future__ import annotations

import numpy as np

from .scene import Scene


def reference_depth(scene: Scene) -> np.ndarray:
    """
    Return the relative depth of what the reference of a scene shows, (M, N) float32, ground = 1.

    A pixel belongs to the nearest layer that covers half of it or more.
    """
    rows, cols = scene.shape
    depth = np.ones((rows, cols), np.float32)
    for layer in scene.layers:  # the nearest come last
        assert float(layer.x).is_integer() and float(layer.y).is_integer()
        top, left = int(layer.y), int(layer.x)
        bottom, right = top + layer.cover.shape[0], left + layer.cover.shape[1]
        inside = np.s_[max(top, 0) : min(bottom, rows), max(left, 0) : min(right, cols)]
        cover = layer.cover[
            inside[0].start - top : inside[0].stop - top,
            inside[1].start - left : inside[1].stop - left,
        ]
        depth[inside][cover >= 0.5] = layer.relative_depth
    return depth
