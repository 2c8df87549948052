"""
Camera paths for synthetic frames: functions of the row time [rows] with poses (n, 6) [px, deg, 1].

They are made of parts around pose zero that add up, and can be scaled to a wanted motion blur.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from rsmb_ros.core.shutter import ShutterTiming

from .exposure import Path, pixel_moves, row_instants

WOBBLE_ROWS = 160.0  # rows per turn of the shake, a circle: every row is equally blurred
DRIFT_PERIOD = 9.0  # s, of the offset's slow circle around the waypoint
MOTIONS = ('smooth', 'jello', 'walk', 'constant')
# Share of each component in a usual motion during a frame: px, px, deg, 1, deg, deg.
SIX_DOF = np.array([1.0, 1.0, 0.02, 2e-4, 0.006, 0.006])
POSE_ZERO = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])


def still(times: np.ndarray) -> np.ndarray:
    """Return pose zero at all times: the camera of the reference."""
    return np.tile(POSE_ZERO, (len(times), 1))


def offset(pose: np.ndarray, *parts: Path) -> Path:
    """Return a path that stays at `pose` (6,), plus the motions of `parts` around it."""

    def poses(times: np.ndarray) -> np.ndarray:
        return pose + sum((part(times) - POSE_ZERO for part in parts), np.zeros((len(times), 6)))

    return poses


def constant(velocity: np.ndarray, rows: int) -> Path:
    """Return uniform motion by `velocity` (6,) a row, pose zero at the middle row."""

    def poses(times: np.ndarray) -> np.ndarray:
        return POSE_ZERO + (times[:, None] - (rows - 1) / 2) * velocity

    return poses


def smooth(rng: np.random.Generator, amplitude: np.ndarray, period_rows: float) -> Path:
    """Return three slow waves a component, about `amplitude` (6,) and `period_rows` long."""
    periods = period_rows * rng.uniform(0.6, 1.7, (3, 6))
    phases = rng.uniform(0, 2 * np.pi, (3, 6))
    sizes = amplitude * rng.dirichlet(np.full(3, 2.0), 6).T

    def poses(times: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * times[:, None, None] / periods + phases
        return POSE_ZERO + (sizes * np.sin(angle)).sum(axis=1)

    return poses


def jello(rng: np.random.Generator, amplitude: np.ndarray, period_rows: float) -> Path:
    """Return a vibration: `amplitude` (6,), x and y a quarter turn apart, `period_rows` a turn."""
    phase = rng.uniform(0, 2 * np.pi)
    phases = phase + np.array([0.0, 0.5 * np.pi, *rng.uniform(0, 2 * np.pi, 4)])

    def poses(times: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi * times[:, None] / period_rows + phases
        return POSE_ZERO + amplitude * np.sin(angle)

    return poses


def walk(
    rng: np.random.Generator, amplitude: np.ndarray, timing: ShutterTiming, rows: int, knot: float
) -> Path:
    """Return a random walk with a new direction every `knot` rows, `amplitude` (6,) in all."""
    half = 0.5 * timing.exposure_rows + 2 * knot
    times = np.arange(-half, rows + half + knot, knot)
    steps = rng.normal(0.0, 1.0, (len(times), 6)).cumsum(axis=0)
    steps -= steps.mean(axis=0)
    steps *= amplitude / np.maximum(np.abs(steps).max(axis=0), 1e-9)
    spline = CubicSpline(times, steps)

    def poses(times: np.ndarray) -> np.ndarray:
        return POSE_ZERO + spline(times)

    return poses


def stairs(poses: np.ndarray, per_row: int, per_exposure: int) -> Path:
    """
    Return the discrete path of the ECCV 2014 recipe: `poses` ((M-1) b + a, 6).

    Row i uses the a = `per_exposure` poses that start at i b, b = `per_row`; expose it with
    a / b rows and a instants a row. Their a = 20, b = 3; rolling shutter alone: a = 1.
    """

    def path(times: np.ndarray) -> np.ndarray:
        index = np.rint(times * per_row + 0.5 * (per_exposure - 1)).astype(int)
        return poses[np.clip(index, 0, len(poses) - 1)]

    return path


def scaled(path: Path, factor: float) -> Path:
    """Return `path` with all its motion around pose zero multiplied by `factor`."""

    def poses(times: np.ndarray) -> np.ndarray:
        return POSE_ZERO + factor * (path(times) - POSE_ZERO)

    return poses


def wobble(
    motion: str, components: np.ndarray, timing: ShutterTiming, rows: int, rng: np.random.Generator
) -> Path:
    """
    Return a motion around pose zero during a frame, of no particular size.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    components : ndarray of shape (6,)
        Share of each component of the pose.

    """
    period = float(rng.uniform(0.5, 1.2)) * rows
    signs = components * rng.uniform(0.3, 1.0, 6) * rng.choice([-1.0, 1.0], 6)
    if motion == 'constant':
        return constant(signs, rows)
    if motion == 'jello':
        return jello(rng, components, 0.45 * period)
    if motion == 'walk':
        return walk(rng, components, timing, rows, 0.2 * period)
    return smooth(rng, components, period)


def blurred_by(path: Path, blur_px: float, timing: ShutterTiming, rows: int) -> Path:
    """Return `path` scaled so that the median row's motion during its exposure is `blur_px`."""
    lengths = [pixel_moves(poses).sum() for poses in row_instants(path, timing, rows, 33)]
    # 33 instants leave out half a step at both ends
    return scaled(path, blur_px / max(float(np.median(lengths)) * 33 / 32, 1e-9))


def swaying_by(path: Path, sway_px: float, rows: int) -> Path:
    """Return `path` scaled so that the frame's rows lie up to `sway_px` apart from pose zero."""
    poses = path(np.arange(rows, dtype=float))
    reach = pixel_moves(np.stack([np.broadcast_to(POSE_ZERO, poses.shape), poses], axis=1))
    return scaled(path, sway_px / max(float(reach.max()), 1e-9))


@dataclass(frozen=True)
class Hover:
    """
    A drone that holds its waypoint by `offset_px`, shaken so that each row is blurred by `blur_px`.

    Rotation, zoom and tilt sway slowly and a little with it.
    """

    offset_px: float  # distance of the image from the reference [px]
    blur_px: float  # path length during one row's exposure [px]
    exposure_rows: float  # [rows]
    line_delay: float  # s between the starts of two rows
    phase: float = 0.0  # rad, tells flights apart
    rotation_deg: float = 0.4  # amplitude of r_z
    tilt_deg: float = 0.12  # amplitude of r_x, r_y
    zoom: float = 0.003  # amplitude of the scale's difference from 1

    def poses(self, start: float, rows: np.ndarray) -> np.ndarray:
        """Poses (n, 6) at row times `rows` (n,) of a frame that is read from `start` [s] on."""
        time = start + rows * self.line_delay
        slow = 2 * np.pi * time / DRIFT_PERIOD + self.phase
        poses = np.empty((len(rows), 6))
        poses[:, 0] = self.offset_px * np.cos(slow)
        poses[:, 1] = self.offset_px * np.sin(slow)
        if self.exposure_rows > 0:
            turn = 2 * np.pi / WOBBLE_ROWS
            radius = self.blur_px / (self.exposure_rows * turn)
            fast = turn * time / self.line_delay + self.phase
            poses[:, 0] += radius * np.sin(fast)
            poses[:, 1] += radius * np.cos(fast)
        poses[:, 2] = self.rotation_deg * np.sin(1.7 * slow + 0.3)
        poses[:, 3] = 1.0 + self.zoom * np.sin(1.3 * slow + 1.1)
        poses[:, 4] = self.tilt_deg * np.sin(0.9 * slow + 2.0)
        poses[:, 5] = self.tilt_deg * np.cos(1.1 * slow + 0.7)
        return poses
