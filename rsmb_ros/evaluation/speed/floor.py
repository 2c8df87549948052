"""
The least work of registration and rendering: operations and bytes, counted by hand.

One linearisation samples the half-pixel reference at every point and instant, spreads the gradients
over the control points (Eq. 1 and 6) and sums the normal equations. Rendering reads the reference
once per instant for every pixel. Nothing else is counted: no coarse start, no pyramid, no Python.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsmb_ros.core.arrow import EXTRA
from rsmb_ros.core.motion import CameraPath
from rsmb_ros.core.normal_equations import point_step
from rsmb_ros.core.path_estimator import level_count
from rsmb_ros.core.points import select_points
from rsmb_ros.core.render import STEP_PX

from .machine import Rates

PASSES = 3  # linearisations of each image size: a start that is off needs no fewer
# Operations of a point at an instant: place in the reference 23, bilinear value and gradient 15,
# means 6, the six columns of the motion 10; and what each degree of freedom takes for the four
# control points it is spread over and for the exposure.
SAMPLE = 54
SAMPLE_PER_DOF = 10
POINT = 60  # of a point: tone curve and its slope, gain, robust weight; a power counts 15
RENDER_SAMPLE = 15  # of a pixel at an instant: next place, bilinear value, its share
RENDER_PIXEL = 30  # of a pixel: gain, tone curve, residual
LINE = 64  # bytes that memory hands out at once
VALUE = 4  # bytes of a float32


@dataclass(frozen=True)
class Work:
    """Floating-point operations, a fused multiply-add for two, and bytes touched at least."""

    flops: float
    bytes: float

    def __add__(self, other: Work) -> Work:
        return Work(self.flops + other.flops, self.bytes + other.bytes)

    def times(self, count: float) -> Work:
        """Return so many times the work."""
        return Work(count * self.flops, count * self.bytes)

    def seconds(self, rates: Rates) -> float:
        """Return the time a machine needs that loads and calculates at once [s]."""
        return max(self.flops / rates.flops, self.bytes / rates.bytes)


@dataclass(frozen=True)
class FrameFloor:
    """Least work of one frame, and what it is counted from."""

    points: int  # of all image sizes
    samples: float  # instants per row of points, mean at full size
    unknowns: float  # a row depends on, mean
    fit: Work
    render: Work

    def seconds(self, rates: Rates) -> float:
        """Return the least time of fit and rendering [s]."""
        return self.fit.seconds(rates) + self.render.seconds(rates)


def frame_floor(path: CameraPath, dof: int) -> FrameFloor:
    """
    Count what a frame with this motion takes.

    Parameters
    ----------
    path : CameraPath
        As it was found, or as it is.
    dof : int
        Degrees of freedom that are fitted.

    """
    points, first_samples, fit = 0, 0.0, Work(0.0, 0.0)
    unknowns = (path.exposure_rows / path.knot_rows + 4.0) * dof + EXTRA
    for n in range(level_count(path.grid)):
        factor = 2.0**n
        found = select_points(np.zeros([side // 2**n for side in path.grid.live_shape], 'f4'), n)
        at = np.minimum(((found.rows + 0.5) * factor).astype(int), len(path.row_times) - 1)
        samples = path.samples_per_row(point_step(n))[at]
        points += found.columns.size
        first_samples = first_samples or float(samples.mean())
        fine_bytes = _fine_bytes(path) / 4**n
        once = linearisation(found.columns.shape[1], samples, unknowns, dof, fine_bytes)
        fit += once.times(PASSES)
    return FrameFloor(points, first_samples, unknowns, fit, rendering(path))


def linearisation(
    points: int, samples: np.ndarray, unknowns: float, dof: int, fine_bytes: float
) -> Work:
    """
    Count one linearisation.

    Parameters
    ----------
    points : int
        In a row of points.
    samples : ndarray of shape (R,)
        Instants of each row of points.
    unknowns : float
        A row depends on: the lower triangle of its normal equations is summed point by point.
    dof : int
        Degrees of freedom.
    fine_bytes : float
        Size of the half-pixel reference: no more of it can be touched.

    """
    sampled = points * float(np.sum(samples)) * (SAMPLE + SAMPLE_PER_DOF * dof)
    # an unknown: light 1, weight 1, gradient 2, its half of the symmetric products n + 1
    summed = points * len(samples) * (POINT + unknowns * (unknowns + 5.0))
    rows_of_cells = min(fine_bytes, 2.0 * LINE * points * len(samples))
    held = 4.0 * VALUE * points * len(samples)  # column (two), value, residual
    return Work(sampled + summed, rows_of_cells + held)


def rendering(path: CameraPath) -> Work:
    """Count one grey rendering of a frame and its residual."""
    rows, cols = path.grid.live_shape
    samples = float(path.samples_per_row(STEP_PX).sum())
    flops = cols * (samples * RENDER_SAMPLE + rows * RENDER_PIXEL)
    # written: light, display value, residual, one byte of mask; read: the live frame
    return Work(flops, _fine_bytes(path) + rows * cols * (4.0 * VALUE + 1.0))


def _fine_bytes(path: CameraPath) -> float:
    rows, cols = path.grid.reference_shape
    return 4.0 * VALUE * rows * cols
