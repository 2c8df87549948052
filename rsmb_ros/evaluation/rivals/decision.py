"""From a registration to changes: the same decisions for every rival."""

from __future__ import annotations

import cv2
import numpy as np
from skimage.filters import threshold_otsu

from rsmb_ros.core.config import ChangeConfig
from rsmb_ros.core.segmentation import BASE_PIXELS, CLOSE_RADIUS, without_small

from ..methods import Registration

SMOOTHING = 1.5  # px, sigma of the Gaussian
MIN_DIFFERENCE = 25.0  # grey levels; Otsu splits pure noise, too
LIGHT_PIXELS = 20_000  # that the light is fitted to, about
LIGHT_ITERATIONS = 15
HUBER = 1.345  # sigma; residuals beyond it count less


def otsu(live: np.ndarray, registration: Registration) -> np.ndarray:
    """
    Threshold the difference by Otsu's method: what users do first.

    Parameters
    ----------
    live : ndarray of shape (M, N), float32
        Grey levels.
    registration : Registration

    Returns
    -------
    ndarray of shape (M, N), bool
        Changed pixels; none outside the reference.

    """
    difference = np.abs(live - registration.registered)
    threshold = threshold_otsu(difference[registration.inside])
    return cleaned((difference > threshold) & registration.inside)


def tuned(live: np.ndarray, registration: Registration) -> np.ndarray:
    """Like `otsu`, after equal light and smoothing, and never below 25 grey levels."""
    inside = registration.inside
    gain, bias = fitted_light(registration.registered[inside], live[inside])
    expected = np.where(inside, gain * registration.registered + bias, live)
    difference = np.abs(cv2.GaussianBlur(live - expected, (0, 0), SMOOTHING))
    threshold = max(float(threshold_otsu(difference[inside])), MIN_DIFFERENCE)
    return cleaned((difference > threshold) & inside)


def fitted_light(reference: np.ndarray, live: np.ndarray) -> tuple[float, float]:
    """Gain and bias [grey levels] that turn n reference values into live ones (Huber, IRLS)."""
    every = max(1, len(reference) // LIGHT_PIXELS)
    x, y = reference[::every].astype(np.float64), live[::every].astype(np.float64)
    gain, bias = 1.0, float(np.median(y - x))
    for _ in range(LIGHT_ITERATIONS):
        residual = np.abs(y - gain * x - bias)
        sigma = max(1.4826 * float(np.median(residual)), 0.5)  # half a quantum at least
        weight = 1 / np.maximum(residual / (HUBER * sigma), 1.0)
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        spread = float(weight @ (x - mean_x) ** 2)
        if spread < 1e-6 * weight.sum():
            return 1.0, bias  # a flat reference tells no gain
        gain = float(weight @ ((x - mean_x) * (y - mean_y))) / spread
        bias = float(mean_y - gain * mean_x)
    return gain, bias


def cleaned(mask: np.ndarray) -> np.ndarray:
    """Open, close as `core.segmentation.candidates` does, drop small regions; (M, N) bool."""
    radius = max(1, round(CLOSE_RADIUS * float(np.sqrt(mask.size / BASE_PIXELS))))
    size = 2 * radius + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    # a frame of background, else closing glues regions to the image's border
    padded = cv2.copyMakeBorder(opened, size, size, size, size, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[size:-size, size:-size]
    return without_small(np.ascontiguousarray(closed), ChangeConfig()).astype(bool)
