"""What one frame says by itself, and what the frames before it make of that."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from threadpoolctl import ThreadpoolController

from .change_finder import Finding
from .changes import Change, changes_of, mask_of
from .clock import Clock
from .config import ChangeConfig
from .motion import CameraPath
from .persistence import RegionMemory
from .regions import static_region
from .types import REGISTERED, Result
from .workers import Workers

_BLAS = ThreadpoolController()


@dataclass(frozen=True)
class Outcome:
    """One live frame, compared with the reference alone."""

    result: Result  # with every change of this frame
    changes: tuple[Change, ...] = ()  # the same ones, with their pixels
    path: CameraPath | None = None  # None: not registered, there is nothing to remember


@dataclass(frozen=True)
class BlankViews:
    """Views of a frame that could not be registered: black."""

    reference: np.ndarray
    live: np.ndarray

    def registered(self) -> np.ndarray:
        """Return black in the live frame's size and the reference's channels."""
        return np.zeros(self.live.shape[:2] + self.reference.shape[2:], np.uint8)

    def rectified(self) -> np.ndarray:
        """Return black in the reference's size and the live frame's channels."""
        return np.zeros(self.reference.shape[:2] + self.live.shape[2:], np.uint8)


def outcome_of(finding: Finding, config: ChangeConfig, executor: Workers, clock: Clock) -> Outcome:
    """Return what a registered frame says."""
    frame = finding.frame
    changes = changes_of(finding, config, executor)
    mask = mask_of(changes, frame.grey.shape)
    result = Result(
        status=REGISTERED,
        reason='',
        change_mask=mask * np.uint8(255),
        valid_mask=frame.judged * np.uint8(255),
        residual=np.where(frame.judged, frame.residual, np.float32(0.0)),
        row_motion=frame.row_motion,
        row_uncertainty=frame.row_uncertainty,
        regions=(*(change.region for change in changes), *map(static_region, finding.layers)),
        exposure_rows=frame.exposure_rows,
        gain=frame.gain,
        timings_ms=clock.timings_ms,
        views=frame,
    )
    return Outcome(result, tuple(changes), frame.path)


def remembered(outcome: Outcome, memory: RegionMemory, stamp: int | None) -> Result:
    """
    Return the result with the changes that the frames so far confirm.

    Parameters
    ----------
    outcome : Outcome
        Of the frame after the last one that `memory` took in.
    memory : RegionMemory
        One that is not enabled confirms everything.
    stamp : int, optional
        When the frame was taken [ns].

    """
    result = outcome.result
    if outcome.path is None or not memory.enabled:
        return result
    clock = Clock()
    with clock.step('persistence'), _BLAS.limit(limits=1, user_api='blas'):
        found = [change.blob for change in outcome.changes]
        known = memory.update(found, outcome.path, result.valid_mask > 0, stamp)
    changes = [
        replace(change, region=replace(change.region, **asdict(one)))
        for change, one in zip(outcome.changes, known, strict=True)
        if one
    ]
    static = (region for region in result.regions if region.kind != 'change')
    return replace(
        result,
        change_mask=mask_of(changes, result.change_mask.shape) * np.uint8(255),
        regions=(*(change.region for change in changes), *static),
        timings_ms={**result.timings_ms, **clock.timings_ms},
    )
