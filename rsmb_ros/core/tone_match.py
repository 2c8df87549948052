"""
What gain and bias of the light leave of another tone curve: contrast, white balance, processing.

Two cameras, or one at other settings, show the same light by other curves. What is left of that is
a curve over the display values, one for each colour. It is asked in many places of the frame and
follows most of them: what has changed in one or two places does not bend it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ._kernels.tones import add_offsets, add_tones, count_offsets
from .photometric import LUMA_WEIGHTS
from .render import ONE_WEIGHT, Shown
from .workers import Workers, each

KNOTS = 17  # of a curve, evenly over 0..255
BINS = 32  # of intensity, in which a place says what it is off by
PLACES_ACROSS = 16  # of the frame
STEP = 4  # px of squares that are asked as one
ALL = 0.999  # of a square that must be known
FEWEST = 3  # squares of a place and bin that count
BRIGHT = 250  # display value from which on light may be clipped
MOST = 60  # grey levels that a square can say it is off by
STIFFNESS = 0.5  # of a curve's bends, in places
STILL = 1e-2  # of its offsets: nothing is off where nothing is known
SHARPEST = 0.5  # grey levels; the loss is that of medians beyond
ROUNDS = 8
STANDS = 0.1  # grey levels; a round that moves a curve by less is the last
OUTLIER = 15.0  # grey levels; places that are off by more count as that
# Of the misfit of the places, share and grey levels that a curve must explain. Without another
# curve it is at most .2 (.05 in most frames), contrast, haze and white balance have .3 to .9.
LEAST_SHARE, LEAST = 0.25, 0.5


@dataclass(frozen=True, eq=False)
class ToneMatch:
    """How display values of a live frame differ from those predicted."""

    offsets: np.ndarray  # (C, 256) float32 [grey levels], by predicted value; C = 1: all colours

    @cached_property
    def grey(self) -> np.ndarray:
        """Offsets of grey pixels (256,) float32."""
        weights = LUMA_WEIGHTS if len(self.offsets) > 1 else ONE_WEIGHT
        return weights @ self.offsets

    def of_grey(self, values: np.ndarray) -> np.ndarray:
        """Return grey levels 0..255 of any shape as the live frame shows them, float32."""
        lighter = values + np.interp(values, np.arange(256), self.grey)
        return np.clip(lighter, 0.0, 255.0).astype(np.float32)

    def of(self, shown: Shown) -> Shown:
        """Return what is shown as the live frame shows it."""
        if shown.colours is None or shown.colours.ndim == 2:
            grey = self.of_grey(shown.grey)
            colours = None if shown.colours is None else np.rint(grey).astype(np.uint8)
            return Shown(grey, colours, shown.complete)
        grey, colours = shown.grey.copy(), np.empty_like(shown.colours)
        offsets = np.ascontiguousarray(np.broadcast_to(self.offsets, (3, 256)))
        add_tones(colours.ravel(), shown.colours.ravel(), offsets, LUMA_WEIGHTS, grey.ravel())
        return Shown(grey, colours, shown.complete)


def tone_match(
    shown: Shown, live: np.ndarray, grey: np.ndarray, executor: Workers
) -> ToneMatch | None:
    """
    Compare what is shown of a reference with a live frame; None where their curves are the same.

    Parameters
    ----------
    shown : Shown
        The whole frame.
    live : ndarray of shape (M, N) or (M, N, 3), uint8
    grey : ndarray of shape (M, N), float32
        Grey levels of `live`.
    executor : Workers
        Threads that share the work.

    """
    if shown.colours is not None and shown.colours.ndim == live.ndim:
        pair = shown.colours, live
    else:  # one of them is grey
        pair = tuple(np.rint(image).astype(np.uint8) for image in (shown.grey, grey))
    rows, columns = (length // STEP for length in grey.shape)
    size = {'dsize': (columns, rows), 'interpolation': cv2.INTER_AREA}
    # means: where pixels hold noise, what is bright here by chance is less so there
    smaller = each(executor, lambda image: cv2.resize(image, **size), pair)
    before, after = (image.reshape(rows, columns, -1) for image in smaller)
    whole = cv2.resize(shown.complete.astype(np.float32), **size) > ALL
    cell = max(2, columns // PLACES_ACROSS)
    places = -(-rows // cell) * -(-columns // cell)
    sums = np.zeros((before.shape[2], places, BINS, 3), np.int64)
    count_offsets(before, after, whole, cell, BRIGHT, MOST, sums)
    fits = each(executor, _curve, list(sums.reshape(len(sums), -1, 3)))
    if not any(different for _, different in fits):
        return None
    values = np.linspace(0.0, KNOTS - 1.0, 256)
    curves = [np.interp(values, np.arange(KNOTS), curve) for curve, _ in fits]
    return ToneMatch(np.array(curves, np.float32))


def _curve(table: np.ndarray) -> tuple[np.ndarray, bool]:
    """
    Lay a curve through the sums of places and bins (n, 3), see `count_offsets`.

    Returns its offsets at the knots (KNOTS,), 0 where little is to be explained, and whether it
    explains enough.
    """
    curve = np.zeros(KNOTS)
    number, intensity, offset = table[table[:, 0] >= FEWEST].T
    if len(number) < KNOTS:
        return curve, False
    at, off = intensity / number * ((KNOTS - 1) / 255.0), offset / number
    without = _cost(off)
    if without <= LEAST:
        return curve, False
    bends = np.diff(np.eye(KNOTS), 2, axis=0)
    prior = STIFFNESS * bends.T @ bends + STILL * np.eye(KNOTS)
    for _ in range(ROUNDS):
        normal, target = prior.copy(), np.zeros(KNOTS)
        add_offsets(at, off, curve, SHARPEST, normal, target)
        last, curve = curve, np.linalg.solve(normal, target)
        if np.abs(curve - last).max() < STANDS:
            break
    left = off - np.interp(at, np.arange(KNOTS), curve)
    return curve, without - _cost(left) > max(LEAST, LEAST_SHARE * without)


def _cost(off: np.ndarray) -> float:
    """Return what places are off by (n,), in the mean, outliers truncated [grey levels]."""
    return float(np.minimum(np.abs(off), OUTLIER).mean())
