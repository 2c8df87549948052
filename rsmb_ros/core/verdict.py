"""Whether a fitted frame may be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .agreement import MIN_SHARPNESS, Agreement, agreement
from .config import RegistrationConfig
from .frame import RegisteredFrame
from .lost_rows import Compared


@dataclass(frozen=True)
class Verdict:
    """What is thought of a fitted frame."""

    problem: str  # why it must not be trusted, '' when it may
    found: Agreement | None = None  # None where too little of it lies in the reference

    def misfit(self, frame: RegisteredFrame) -> float:
        """Residual of the frame for each block that agrees: it must not go by less being seen."""
        agreed = 0 if self.found is None else np.count_nonzero(self.found.agreed)
        return frame.cost / agreed if agreed else np.inf


def verdict_on(frame: RegisteredFrame, limits: RegistrationConfig) -> Verdict:
    """Say what is thought of a frame, as fitted."""
    overlap = np.count_nonzero(frame.complete) / frame.complete.size
    if overlap < limits.min_overlap:
        return Verdict(
            f'no overlap: {overlap:.0%} of the frame lies in the reference, '
            f'{limits.min_overlap:.0%} needed'
        )
    likeness, problem = frame.likeness, ''
    agreed, sharp = likeness.found.share, likeness.sharpness
    if agreed is None:
        problem = 'no texture where the live frame overlaps the reference'
    elif agreed < limits.min_agreement:
        problem = (
            f'live frame and reference do not match: {agreed:.0%} of the textured blocks '
            f'agree, {limits.min_agreement:.0%} needed'
        )
    elif sharp < MIN_SHARPNESS:
        problem = (
            'live frame and reference do not match: only a blur that the live frame does not '
            f'have makes them alike, sharpness {sharp:.2f} < {MIN_SHARPNESS}'
        )
    return Verdict(problem, likeness.found)


def problem_of_rest(frame: Compared, grey: np.ndarray, lost: np.ndarray, needed: float) -> str:
    """
    Say why what is left of a frame must not be trusted, '' where it may.

    Parameters
    ----------
    frame : Compared
        With all that explains it.
    grey : ndarray of shape (M, N), float32
        Its grey levels.
    lost : ndarray of shape (M,), bool
        Rows at which the path does not lie: they agree by chance.
    needed : float
        Share of all textured blocks that must agree in the other rows.

    """
    found = agreement(frame.predicted, grey, frame.complete)
    share = found.without(lost).share
    if share is None or share >= needed:
        return ''
    return (
        f'path lost in {lost.mean():.0%} of the rows: in the others {share:.0%} of all textured '
        f'blocks agree, {needed:.0%} needed'
    )
