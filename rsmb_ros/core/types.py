"""What the detector returns. Images are (row, col); colour is BGR; grey levels are 0..255."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

REGISTERED = 'registered'
NOT_REGISTERED = 'not_registered'

# Columns of `Result.row_motion` (tau of the report).
MOTION_COLUMNS = ('t_x', 't_y', 'r_z', 'scale', 'r_x', 'r_y')
MOTION_UNITS = ('px', 'px', 'deg', '1', 'deg', 'deg')


@dataclass(frozen=True)
class Region:
    """One connected object in the live image."""

    x: int  # left column of the bounding box [px]
    y: int  # top row of the bounding box [px]
    width: int  # [px]
    height: int  # [px]
    area: int  # [px]
    kind: str  # 'change': not in the reference; 'static': in it, at another depth
    score: float  # confidence that `kind` is right, 0..1
    relative_depth: float | None = None  # d_l, background = 1, nearer < 1; None for a change
    # of changes with `change.persistence_frames` > 1, else None:
    id: int | None = None  # the same object in all frames of one detector, from 1
    first_seen: int | None = None  # stamp of the first frame that showed it [ns]; None: unknown
    reference_x: float | None = None  # column of its centre on the reference's ground [px]
    reference_y: float | None = None  # row of its centre on the reference's ground [px]
    shadow_like: bool = False  # a change of light only, as a cast shadow makes it


class Views(Protocol):
    """Images that are only worth their time when somebody looks at them."""

    def registered(self) -> np.ndarray:
        """Return the reference as the live camera would have seen it."""

    def rectified(self) -> np.ndarray:
        """Return the live image in the geometry of the reference."""


@dataclass(frozen=True)
class Result:
    """
    Outcome for one live frame of M x N px; never an exception on image content.

    A frame that cannot be registered has status ``not_registered``, a `reason`, nothing changed
    and nothing valid, and NaN in `row_motion`.
    """

    status: str  # REGISTERED or NOT_REGISTERED
    reason: str  # '' when registered, else why not, for people
    change_mask: np.ndarray  # (M, N) uint8, 255 changed, 0 not
    valid_mask: np.ndarray  # (M, N) uint8, 255 judged, 0 unknown
    residual: np.ndarray  # chi (M, N) float32, live - registered [grey levels], 0 where unknown
    row_motion: np.ndarray  # (M, 6) float64, centroid tau_c of each row, see MOTION_COLUMNS
    row_uncertainty: np.ndarray  # (M,) float64, std. dev. of the row's place [px]; inf: lost
    regions: tuple[Region, ...]
    exposure_rows: float  # t_e / t_d, given or self-calibrated [rows]
    gain: float  # live / reference, in linear light, at the image centre
    timings_ms: Mapping[str, float]  # step -> ms
    views: Views = field(repr=False)

    @property
    def changes(self) -> tuple[Region, ...]:
        """Regions of kind ``change``: what an operator must look at."""
        return tuple(region for region in self.regions if region.kind == 'change')

    @cached_property
    def registered(self) -> np.ndarray:
        """
        Reference as the live camera would have seen it: warped row by row, blurred, same light.

        (M, N) or (M, N, 3) uint8 like the reference's channels, 0 outside the reference; all 0
        when not registered. Computed on first use.
        """
        return self.views.registered()

    @cached_property
    def rectified(self) -> np.ndarray:
        """
        Live image brought back to the reference's geometry, shape of the reference's grid.

        uint8 with the live image's channels, 0 where the live frame does not reach; all 0 when
        not registered. Computed on first use.
        """
        return self.views.rectified()
