"""Camera paths of a hovering drone, for synthetic frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WOBBLE_ROWS = 160.0  # rows per turn of the shake, a circle: every row is equally blurred
DRIFT_PERIOD = 9.0  # s, of the offset's slow circle around the waypoint


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
