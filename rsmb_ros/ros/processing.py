"""The detector, kept in step with reference, camera and configuration; knows no ROS."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsmb_ros.core import Camera, Config, Detector, FrameError, warm_up
from rsmb_ros.core.types import Result
from rsmb_ros.messages.camera_info import Intrinsics


class Processing:
    """
    Owned by the worker thread, but for `config` and `intrinsics`, which others may set.

    Parameters
    ----------
    config : Config
    log : callable
        Takes one line for people.

    """

    def __init__(self, config: Config, log: Callable[[str], None]) -> None:
        self.config = config  # taken up with the next frame
        self.intrinsics: Intrinsics | None = None  # from camera_info; likewise
        self._log = log
        self._reference: np.ndarray | None = None
        self._depth: np.ndarray | None = None
        self._depth_compiled = False
        self._detector: Detector | None = None
        self._built_with: tuple[Config, float | None] | None = None
        self._guess_logged = self._width_logged = False

    def prepare(self) -> None:
        """Compile the kernels."""
        warm_up(self.config)

    def set_reference(self, image: np.ndarray, depth: np.ndarray | None = None) -> None:
        """
        Take a new reference, (M, N) or (M, N, 3) uint8, and do what is needed only once.

        `depth` is its relative depth (M, N) float32, where that is known.

        Raises
        ------
        FrameError
            If nothing can be compared with it; there is no reference then.

        """
        if depth is not None and not self._depth_compiled:
            warm_up(self.config, depth=True)
            self._depth_compiled = True
        self._reference, self._depth = image, depth
        self._detector = None
        try:
            self._current_detector(image)
        except FrameError:
            self._reference = None  # and not the one before: nobody would notice
            raise

    def detect(self, live: np.ndarray, stamp: int | None = None) -> Result | None:
        """Return the result for a live image taken at `stamp` [ns], None without a reference."""
        if self._reference is None:
            return None
        detector = self._current_detector(self._reference)
        self._log_guess_once(detector.camera_for(live.shape[1]))
        self._log_width_once(live.shape[1])
        return detector.detect(live, stamp)

    def _current_detector(self, reference: np.ndarray) -> Detector:
        told = self.intrinsics
        wanted = (self.config, None if told is None else told.focal_px)
        if self._detector is None or self._built_with != wanted:
            config, focal_px = wanted
            camera = None if focal_px is None else Camera(focal_px)
            self._detector = Detector(reference, camera=camera, config=config, depth=self._depth)
            self._built_with = wanted
        return self._detector

    def _log_guess_once(self, camera: Camera) -> None:
        if camera.guessed and not self._guess_logged:
            self._guess_logged = True
            self._log(
                'no camera_info and camera.focal_px = 0: '
                f'the focal length is guessed, {camera.focal_px:.0f} px'
            )

    def _log_width_once(self, width: int) -> None:
        """Warn of a focal length that is in other pixels than the frame's."""
        told = self.intrinsics
        if self.config.camera.focal_px > 0 or told is None or told.width in (0, width):
            return
        if not self._width_logged:
            self._width_logged = True
            self._log(
                f'camera_info is of images {told.width} px wide, the frames are {width} px wide: '
                'its focal length is used as it is; give camera.focal_px or the right camera_info'
            )
