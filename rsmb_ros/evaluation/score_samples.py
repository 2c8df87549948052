"""Candidates for changes, right ones and wrong ones: what the score of a region is fitted to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core.change_finder import ChangeFinder, Finding
from rsmb_ros.core.changes import changes_of
from rsmb_ros.core.clock import Clock
from rsmb_ros.core.frame import RegisteredFrame
from rsmb_ros.core.path_stage import PathStage
from rsmb_ros.core.regions import traits_of
from rsmb_ros.core.row_frame import RowStage
from rsmb_ros.core.segmentation import Blob

from .case import Case
from .matching import TOUCH_PX

LOW = {'change.threshold_high': 3.0}  # so that there are weak candidates, wrong ones too
FADED = (0.04, 0.6)  # contrast that is left of a faded object, from, to
CHANGED, UNCHANGED = 255, 0  # labels of CDnet


@dataclass(frozen=True)
class Sample:
    """One candidate."""

    case: str  # 'planar/07'
    traits: np.ndarray  # as `core.regions.traits_of` says
    right: bool  # it shows a change


class _Keeping(ChangeFinder):
    """A change finder that keeps what it has found last."""

    last: Finding | None = None

    def find(self, stage: PathStage | RowStage, frame: RegisteredFrame, clock: Clock) -> Finding:
        """Return what is in a frame."""
        self.last = super().find(stage, frame, clock)
        return self.last


def samples_of(case: Case, config: Config) -> Iterator[Sample]:
    """
    Yield the candidates of a case and whether they are right.

    Those that touch only the rim of a change, or what lies outside, are neither.
    """
    config = config.replaced(LOW)
    detector = Detector(case.reference, Camera(case.focal_px) if case.focal_px else None, config)
    finder = detector._finder = _Keeping(config, detector._executor)
    detector.detect(case.live)
    if finder.last is None:
        return
    found = finder.last
    near = _near(case.label != UNCHANGED)
    for change in changes_of(found, config.change, detector._executor):
        right = _covers(change.blob, case.label == CHANGED)
        if right or not _covers(change.blob, near):
            traits = traits_of(change.blob, found.seen.strength, found.frame.judged)
            yield Sample(case.name, traits, right)


def faded(case: Case, rng: np.random.Generator) -> Case:
    """
    Return a case with its changes at a share of their contrast, drawn from `FADED`.

    What is taken is smooth, so that the noise stays. Raises ValueError without a clean frame.
    """
    if case.motion is None or case.motion.clean is None:
        raise ValueError(f'{case.name} has no clean frame to fade to')
    share = float(rng.uniform(*FADED))
    there = (case.label != UNCHANGED)[..., None] if case.live.ndim == 3 else case.label != UNCHANGED
    off = cv2.GaussianBlur(case.motion.clean - case.live, (0, 0), 0.7)
    mixed = case.live + (1.0 - share) * np.where(there, off, 0.0)
    live = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
    return replace(case, name=f'{case.name} faded', live=live)


def _near(mask: np.ndarray) -> np.ndarray:
    size = 2 * TOUCH_PX + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def _covers(blob: Blob, mask: np.ndarray) -> bool:
    return bool(mask[blob.box][blob.mask].any())
