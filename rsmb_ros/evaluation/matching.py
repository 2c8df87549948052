"""Reported changes against the objects that are there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

Box = tuple[int, int, int, int]  # x, y, width, height [px]

FOUND_IOU = 0.25  # of the boxes; motion blur makes both soft at their edges
TOUCH_PX = 5  # blurred rim of an object: a region that reaches into it belongs to the object


@dataclass(frozen=True)
class FrameScore:
    """What was found in one frame."""

    found: tuple[str, ...]  # names of objects
    missed: tuple[str, ...]
    false_alarms: tuple[Box, ...]  # regions that touch no object


@dataclass
class Tally:
    """What was found over a series of frames."""

    frames: int = 0
    present: dict[str, int] = field(default_factory=dict)  # object -> frames it is in
    found: dict[str, int] = field(default_factory=dict)  # object -> frames it was found in
    false_alarms: int = 0

    def add(self, score: FrameScore) -> None:
        """Count one frame."""
        self.frames += 1
        for name in (*score.found, *score.missed):
            self.present[name] = self.present.get(name, 0) + 1
        for name in score.found:
            self.found[name] = self.found.get(name, 0) + 1
        self.false_alarms += len(score.false_alarms)


def score_frame(regions: Iterable[Box], objects: Mapping[str, Box]) -> FrameScore:
    """
    Match the changes reported in one frame with what is there.

    Parameters
    ----------
    regions : iterable of box
        Reported as changed.
    objects : mapping of name to box
        In the frame and not in the reference.

    """
    regions = tuple(regions)
    found = tuple(
        name
        for name, box in objects.items()
        if any(iou(region, box) >= FOUND_IOU for region in regions)
    )
    near = [dilated(box, TOUCH_PX) for box in objects.values()]
    return FrameScore(
        found=found,
        missed=tuple(name for name in objects if name not in found),
        false_alarms=tuple(
            region for region in regions if not any(intersection(region, box) for box in near)
        ),
    )


def iou(one: Box, other: Box) -> float:
    """Return intersection over union, 0..1."""
    common = intersection(one, other)
    return common / (one[2] * one[3] + other[2] * other[3] - common)


def intersection(one: Box, other: Box) -> int:
    """Return the common area [px]."""
    width = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    height = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    return max(width, 0) * max(height, 0)


def dilated(box: Box, by: int) -> Box:
    """Return the box grown by `by` px on each side."""
    x, y, width, height = box
    return x - by, y - by, width + 2 * by, height + 2 * by
