"""This project's detector as one of the methods."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from rsmb_ros.core import REGISTERED, Camera, Config, Detector, Result
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.photometric import luma
from rsmb_ros.core.tone import USUAL

from .methods import Outcome, Registration
from .warping import places_of_poses

NAME = 'rsmb'


class Ours:
    """
    Detector with a configuration; cold for every pair, the reference's preparation counted.

    Parameters
    ----------
    config : Config
        As the node takes it.
    settings : mapping
        What is known of the camera of a suite, by dotted names; wins over `config`.

    """

    name = NAME
    source = 'this project: continuous camera path, layers; its defaults'

    def __init__(self, config: Config, settings: Mapping[str, object] | None = None) -> None:
        self._config = config.replaced(dict(settings or {})).for_one_frame()

    @property
    def gamma(self) -> float:
        """Tone curve that it sums light by, the usual one where it looks for its own."""
        return self._config.camera.gamma or USUAL

    def __call__(self, reference: np.ndarray, live: np.ndarray, focal_px: float | None) -> Outcome:
        """Compare a live frame with the reference."""
        camera = Camera(focal_px) if focal_px else None
        begin = time.perf_counter()
        result = Detector(reference, camera, self._config).detect(live)
        registered = result.registered
        seconds = time.perf_counter() - begin
        return outcome_of(result, registered, live, reference.shape[:2], focal_px, seconds)


def outcome_of(
    result: Result,
    registered: np.ndarray,
    live: np.ndarray,
    shape: tuple[int, ...],
    focal_px: float | None,
    seconds: float,
) -> Outcome:
    """
    Return a result in the form in which every method is scored.

    Parameters
    ----------
    result : Result
        Of a live frame.
    registered : ndarray
        `result.registered`, which is computed on first use.
    live : ndarray
        The frame.
    shape : tuple of int
        Rows and columns of the reference [px].
    focal_px : float or None
        As the detector was given it [px].
    seconds : float
        The detector's time [s].

    """
    return Outcome(
        registered=result.status == REGISTERED,
        reason=result.reason,
        change=result.change_mask > 0,
        valid=result.valid_mask > 0,
        registration=_registration(result, live, registered, shape, focal_px),
        seconds=seconds,
        exposure_rows=result.exposure_rows,
        depths=tuple(_static_objects(result)),
    )


def _registration(
    result: Result,
    live: np.ndarray,
    registered: np.ndarray,
    shape: tuple[int, ...],
    focal_px: float | None,
) -> Registration | None:
    if result.status != REGISTERED:
        return None
    rows, cols = result.change_mask.shape
    focal = focal_px or Camera.guess(cols).focal_px
    places = places_of_poses(result.row_motion, Grid((rows, cols), (shape[0], shape[1]), focal))
    limits = np.array([shape[1] - 1, shape[0] - 1])
    inside = ((places >= 0) & (places <= limits)).all(axis=-1)
    grey = luma(registered)
    known = inside & (grey > 0)  # 0: not all of the exposure is known
    # of what is judged the prediction is known without the rounding to bytes, as the rivals' is
    predicted = np.where(result.valid_mask > 0, luma(live) - result.residual, grey)
    return Registration(predicted, known, places)


def _static_objects(result: Result) -> list[tuple[np.ndarray, float]]:
    found = []
    for region in result.regions:
        if region.kind == 'static' and region.relative_depth is not None:
            mask = np.zeros(result.change_mask.shape, bool)
            box = np.s_[region.y : region.y + region.height, region.x : region.x + region.width]
            mask[box] = True
            found.append((mask, region.relative_depth))
    return found
