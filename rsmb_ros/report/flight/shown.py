"""Frames and places of a flight in pictures, small enough to keep many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rsmb_ros.core.types import Region, Result

from ..outlines import outline_path
from ..pictures import Cut, Picture, cut_around, encoded
from .ground import Ground
from .places import Place, Views
from .records import FrameRecord
from .row_plot import RowPlot, row_plot

# Columns [px] and bytes of one JPEG.
FRAME = 900, 100_000
THUMBNAIL = 160, 6_000
CROP = 400, 20_000
GLIMPSE = 112, 4_000

_CROP_SIDE = 2.4  # sides of the region's box
_LEAST_CROP = 1 / 9  # of the frame's columns
_LEAST_UNKNOWN = 12.0  # px^2; less is not seen

_path = partial(outline_path, most_points=400)  # in a crop


@dataclass(frozen=True)
class Mark:
    """One region in the picture of a frame."""

    region: Region
    place: Place | None


@dataclass(frozen=True)
class ShownFrame:
    """One frame with its pictures."""

    record: FrameRecord
    reference: int  # its number
    width: int  # of the frame [px]
    height: int
    live: Picture
    thumbnail: Picture
    registered: Picture | None  # None: not registered
    outlines: str  # of the changes, SVG path [px of the frame]
    unknown: str  # what was not judged
    marks: Sequence[Mark]
    plot: RowPlot | None


def shown_frame(
    record: FrameRecord, reference: int, live: np.ndarray, result: Result, marks: Sequence[Mark]
) -> ShownFrame:
    """Return a frame with its pictures."""
    known = record.registered
    return ShownFrame(
        record=record,
        reference=reference,
        width=live.shape[1],
        height=live.shape[0],
        live=encoded(live, *FRAME),
        thumbnail=encoded(live, *THUMBNAIL),
        registered=encoded(result.registered, *FRAME) if known else None,
        outlines=outline_path(result.change_mask),
        unknown=outline_path(result.valid_mask == 0, _LEAST_UNKNOWN) if known else '',
        marks=marks,
        plot=row_plot(result) if known else None,
    )


def cut_of(region: Region, shape: tuple[int, int]) -> Cut:
    """Return what is shown of a frame of `shape` (rows, cols) around a region."""
    side = _CROP_SIDE * max(region.width, region.height)
    middle = region.x + region.width / 2, region.y + region.height / 2
    return cut_around(*middle, (side, side), shape, round(_LEAST_CROP * shape[1]))


def views_of(
    region: Region, live: np.ndarray, reference: np.ndarray, result: Result, ground: Ground
) -> Views:
    """Return one sighting of a region in pictures."""
    rows, cols = live.shape[:2]
    cut = cut_of(region, (rows, cols))
    outline = _mask_of(region, result)
    there = _on_reference(cut, reference, ground)
    shown = _path(outline, move=lambda points: points - (cut.left, cut.top))
    return Views(
        live=encoded(cut.of(live), *CROP),
        registered=encoded(cut.of(result.registered), *CROP),
        reference=encoded(there.of(reference), *CROP) if there else None,
        size=(cut.width, cut.height),
        reference_size=(there.width, there.height) if there else (1, 1),
        outline=shown,
        unknown=_path(cut.of(result.valid_mask) == 0, _LEAST_UNKNOWN),
        reference_outline=_moved_outline(outline, ground, there) if there else '',
    )


def _moved_outline(mask: np.ndarray, ground: Ground, there: Cut) -> str:
    """Return the outline of pixels of the frame in a part of the reference."""

    def move(points: np.ndarray) -> np.ndarray:
        return ground.on_reference(points) - (there.left, there.top)

    return _path(mask, move=move)


def _mask_of(region: Region, result: Result) -> np.ndarray:
    """Return the pixels of a region; of a static one, of which no mask is kept, its box."""
    box = np.s_[region.y : region.y + region.height, region.x : region.x + region.width]
    mask = np.zeros(result.change_mask.shape, np.uint8)
    mask[box] = result.change_mask[box] if region.kind == 'change' else 1
    return mask


def _on_reference(cut: Cut, reference: np.ndarray, ground: Ground) -> Cut | None:
    """Return what shows the same part of the ground; None where that is not known."""
    right, bottom = cut.left + cut.width - 1, cut.top + cut.height - 1
    corners = [(cut.left, cut.top), (right, cut.top), (cut.left, bottom), (right, bottom)]
    mapped = ground.on_reference(np.array(corners, np.float64))
    if not np.isfinite(mapped).all():
        return None
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    width, height = high - low + 1
    scale = np.sqrt(width * height / (cut.width * cut.height))  # the same shape, seldom turned
    size = scale * cut.width, scale * cut.height
    x, y = (low + high) / 2
    return cut_around(x, y, size, reference.shape[:2], 8)
