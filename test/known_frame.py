"""Frames whose camera path is known, so that what follows the registration is tested alone."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from rsmb_ros.core._kernels.fit_row import EXTRA
from rsmb_ros.core.config import ChangeConfig, LayersConfig
from rsmb_ros.core.depth_search import DepthSearch
from rsmb_ros.core.evidence import NoiseTable, Texture, evidence
from rsmb_ros.core.frame import PathFrame
from rsmb_ros.core.motion import (
    CameraPath,
    Grid,
    coordinates_from_poses,
    homographies,
    still_path,
)
from rsmb_ros.core.path_fit import PathFit
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.reference import Reference
from rsmb_ros.core.segmentation import Blob, blobs, candidates
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, Sheet, Truth, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import Hover

EXPOSURE = 25.0  # rows
KNOT_ROWS = 24.0
CAMERA = Nuisances(gain=1.08, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92)


@dataclass(frozen=True)
class KnownFrame:
    """A live frame on its true path, and what stands out in it."""

    frame: PathFrame
    truth: Truth
    noise: NoiseTable
    z: np.ndarray  # (M, N) normalised residual, 0 where it is not judged
    mask: np.ndarray  # (M, N) uint8 0/1, candidates

    @property
    def search(self) -> DepthSearch:
        """Search for the depths of its objects."""
        frame = self.frame
        return DepthSearch(
            frame,
            self.noise,
            frame.energy(self.noise),
            None,
            (self.mask > 0) | ~frame.judged,
            LayersConfig(),
            ChangeConfig(),
        )

    def blobs_on(self, place: np.ndarray) -> list[Blob]:
        """Candidates that touch a place (M, N) bool."""
        return [blob for blob in blobs(self.mask) if (blob.mask & place[blob.box]).any()]


def known_frame(
    before: Scene,
    executor: Executor,
    objects: Sequence[Sheet] = (),
    after: Scene | None = None,
    nuisances: Nuisances = CAMERA,
    offset: float = 28.0,
    blur: float = 4.0,
    seed: int = 1,
) -> KnownFrame:
    """Take a frame of `after`, the same scene by default, over a reference of `before`."""
    grid = Grid(before.shape, before.shape, float(before.shape[1]))
    hover = Hover(offset, blur, EXPOSURE, line_delay=6e-5, phase=0.5)
    rng = np.random.default_rng(seed)
    reference = reference_image(before, nuisances, rng)
    live, truth = live_frame(
        after or before, objects, grid, lambda times: hover.poses(0.0, times),
        ShutterTiming(EXPOSURE), nuisances, rng,
    )  # fmt: skip
    path = camera_path(hover, grid)
    fit = PathFit(
        path=path,
        light=nuisances.light,
        defocus=0.0,
        sigma=2.0,
        cost=2.0,
        information=1e6 * np.eye(path.control.size + EXTRA),
        used=1.0,
    )
    grey = luma(live)
    frame = PathFrame(Reference(reference, nuisances.gamma), live, grey, fit, executor)
    noise = NoiseTable.learn(Texture.of(frame.predicted), frame.residual, frame.judged)
    z = np.where(frame.judged, frame.residual / noise(Texture.of(frame.predicted)), np.float32(0.0))
    return KnownFrame(frame, truth, noise, z, candidates(evidence(z), ChangeConfig()))


def camera_path(hover: Hover, grid: Grid) -> CameraPath:
    """Return the spline next to a hovering drone's path, some 0.01 px away."""
    path = still_path(grid, KNOT_ROWS, EXPOSURE, EXPOSURE, bottom_up=False)
    times = np.arange(-0.5 * EXPOSURE, grid.live_shape[0] + 0.5 * EXPOSURE)
    wanted = coordinates_from_poses(hover.poses(0.0, times), grid)
    path.control[:] = np.linalg.lstsq(path.spline_basis(times), wanted, rcond=None)[0]
    return path


def displacement(found: KnownFrame, blob: Blob, depth: float) -> np.ndarray:
    """From where the middle of a blob is to where it were at depth 1: x, y [px]; by homography."""
    height, width = blob.mask.shape
    path = found.frame.path
    x, y = blob.x + 0.5 * width, blob.y + 0.5 * height
    centered = np.array([x - path.grid.center[0], y - path.grid.center[1], 1.0])
    q = path.coordinates(path.row_times[[round(y)]])
    places = [homographies(q, path.grid, d)[0] @ centered for d in (depth, 1.0)]
    own, ground = (place[:2] / place[2] for place in places)
    return own - ground
