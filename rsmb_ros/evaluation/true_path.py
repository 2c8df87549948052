"""What the true camera path gives: the yardstick for what a registration leaves over."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import spline_filter1d

from rsmb_ros.core.camera import Camera
from rsmb_ros.core.motion import CameraPath, Grid, coordinates_from_poses
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.reference import Reference
from rsmb_ros.core.render import blurred
from rsmb_ros.core.sampling import planes_of
from rsmb_ros.core.seen_light import SeenLight
from rsmb_ros.core.workers import Workers

from .case import Case, TrueMotion

APART = 5  # px from changes, layers and what these hide, from which on ground is plain
PAD = 4  # rows the path goes on beyond the exposures of the frame


@dataclass(frozen=True)
class TruePrediction:
    """The reference as a live camera on the true path sees it, M x N px."""

    predicted: np.ndarray  # (M, N) float32 [grey levels]
    where: np.ndarray  # (M, N) bool, unchanged ground away from all that is not


@dataclass(frozen=True)
class TimedPath(CameraPath):
    """A path whose rows are lit at any `times`, as a global shutter does it, too."""

    times: np.ndarray | None = None  # (M,) middles of the rows' exposures [rows]

    @property
    def row_times(self) -> np.ndarray:
        """Time of the middle of each row's exposure (M,) [rows]."""
        assert self.times is not None
        return self.times


def true_prediction(case: Case, gamma: float, threads: int = 2) -> TruePrediction | None:
    """
    Render the reference along the true path of a case, by the renderer that detects, too.

    Path, exposure and shutter are true. The light (gain, its polynomial, bias) and the defocus are
    those that explain the unchanged ground best: a robust fit to nothing but that. Lens distortion,
    noise, JPEG and the error of `gamma` stay, as they do for every method.

    Parameters
    ----------
    case : Case
    gamma : float
        Tone curve that light is summed by.
    threads : int
        The result does not depend on it.

    Returns
    -------
    TruePrediction or None
        None where nobody knows the path.

    """
    motion = case.motion
    if motion is None or motion.path is None:
        return None
    (rows, cols), reference_shape = case.live.shape[:2], case.reference.shape[:2]
    focal = case.focal_px or Camera.guess(cols).focal_px
    path = path_of(motion, Grid((rows, cols), reference_shape, focal))
    reference = Reference(case.reference, gamma)
    with Workers(threads) as executor:
        sharp = [blurred(plane, path, executor) for plane in planes_of(reference.fine_colours)]
        soft = [blurred(plane, path, executor)[0] for plane in planes_of(reference.softer_colours)]
    where = plain_ground(case, motion) & sharp[0][1]
    seen = SeenLight(np.stack([image for image, _ in sharp]), np.stack(soft), gamma)
    return TruePrediction(seen.shown(seen.fitted(luma(case.live), where)), where)


def path_of(motion: TrueMotion, grid: Grid) -> TimedPath:
    """
    Return the true path as splines through its poses at whole rows.

    When the rows are lit (top down, bottom up, all at once) is read off their centroids.
    """
    assert motion.path is not None
    rows = grid.live_shape[0]
    poses = np.pad(motion.path, ((PAD, PAD), (0, 0)), mode='reflect', reflect_type='odd')
    control = spline_filter1d(coordinates_from_poses(poses, grid), axis=0, mode='mirror')
    times = np.arange(rows, dtype=np.float64)
    choices = (times, times[::-1].copy(), np.full(rows, (rows - 1) / 2))
    first_time = motion.path_start - PAD + 1.0  # the first span begins at the second pose
    paths = [
        TimedPath(grid, control, first_time, 1.0, motion.exposure_rows, times=choice)
        for choice in choices
    ]
    wanted = coordinates_from_poses(motion.centroids, grid)
    return min(paths, key=lambda path: float(np.abs(path.row_centroids() - wanted).max()))


def plain_ground(case: Case, motion: TrueMotion) -> np.ndarray:
    """
    Mark unchanged ground (M, N) bool that is `APART` from changes, layers, and unseen places.

    A nearer layer hid ground in the reference that the live frame shows: the faster it moves
    against the ground, the wider its surroundings are left out.
    """
    y, x = np.mgrid[: case.live.shape[0], : case.live.shape[1]].astype(np.float32)
    offset = np.array(case.reference.shape[1::-1]) - case.live.shape[1::-1]
    moved = np.hypot(*np.moveaxis(motion.places - offset / 2 - np.dstack([x, y]), 2, 0))
    known = np.isfinite(moved) & (case.label == 0)
    most = float(moved[known].max(initial=0.0))
    other = _grown(case.label != 0, APART)
    for number, depth in enumerate(motion.depths, 1):
        layer = motion.layers == number
        if layer.any():
            other |= _grown(layer, APART + int(np.ceil(most * abs(1 / depth - 1))))
    return ~other


def _grown(mask: np.ndarray, radius: int) -> np.ndarray:
    size = 2 * radius + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
