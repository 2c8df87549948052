"""A first guess of a displacement by phase correlation."""

from __future__ import annotations

import cv2
import numpy as np


def phase_offset(reference: np.ndarray, live: np.ndarray) -> np.ndarray:
    """
    Displacement of a live frame in the reference, by phase correlation under a Hanning window.

    Parameters
    ----------
    reference, live : ndarray of shape (M', N') and (M, N), float32
        Grey levels; they may differ in size.

    Returns
    -------
    ndarray of shape (2,), float64
        x, y of reference place - live place [px]; 0 if one is flat.

    """
    if np.ptp(reference) == 0 or np.ptp(live) == 0:
        return np.zeros(2)
    rows, cols = (max(pair) for pair in zip(reference.shape, live.shape, strict=True))
    # OpenCV 5 overwrites what it is given: these canvases are ours
    live_canvas, live_corner = _windowed(live, rows, cols)
    reference_canvas, reference_corner = _windowed(reference, rows, cols)
    shift, _ = cv2.phaseCorrelate(live_canvas, reference_canvas)
    return np.array(shift, np.float64) + live_corner - reference_corner


def _windowed(image: np.ndarray, rows: int, cols: int) -> tuple[np.ndarray, np.ndarray]:
    """Put an image without its mean on a canvas of 0, and return it with its corner x, y [px]."""
    height, width = image.shape
    top, left = (rows - height) // 2, (cols - width) // 2
    window = cv2.createHanningWindow((width, height), cv2.CV_64F)
    canvas = np.zeros((rows, cols), np.float64)
    canvas[top : top + height, left : left + width] = (image - image.mean()) * window
    return canvas, np.array([left, top], np.float64)
