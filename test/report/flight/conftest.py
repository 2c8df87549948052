"""Frames of a flight as the detector would return them, without running it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from rsmb_ros.core.types import NOT_REGISTERED, REGISTERED, Region, Result
from rsmb_ros.report.flight.report import FlightReport

STEP_NS = 50_000_000
START_NS = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class KnownViews:
    """Pictures that are simply there."""

    image: np.ndarray

    def registered(self):
        """Return the picture."""
        return self.image

    def rectified(self):
        """Return the picture."""
        return self.image


def change(x, y, width=30, height=20, score=0.9, kind='change', **more):
    """A region that fills its box."""
    depth = 0.9 if kind == 'static' else None
    return Region(x, y, width, height, width * height, kind, score, depth, **more)


def result_of(image, regions=(), shift=(0.0, 0.0), unknown_left=0, reason=''):
    """The result of a frame that lies `shift` (x, y) px off its reference; `reason`: of none."""
    rows = image.shape[0]
    lost = bool(reason)
    mask = np.zeros(image.shape[:2], np.uint8)
    for region in regions:
        if region.kind == 'change':
            mask[region.y : region.y + region.height, region.x : region.x + region.width] = 255
    valid = np.full(image.shape[:2], 0 if lost else 255, np.uint8)
    valid[:, :unknown_left] = 0
    motion = np.tile((*shift, 0.0, 1.0, 0.0, 0.0), (rows, 1)) * (np.nan if lost else 1.0)
    return Result(
        status=NOT_REGISTERED if lost else REGISTERED,
        reason=reason,
        change_mask=mask,
        valid_mask=valid,
        residual=np.zeros(image.shape[:2], np.float32),
        row_motion=motion,
        row_uncertainty=np.full(rows, np.nan if lost else 0.05),
        regions=tuple(regions),
        exposure_rows=float('nan') if lost else 42.0,
        gain=float('nan') if lost else 1.0,
        timings_ms={},
        views=KnownViews(image),
    )


@pytest.fixture(scope='session')
def make():
    """Maker of results: ``make(image, regions, shift, unknown_left, reason)``."""
    return result_of


@pytest.fixture(scope='session')
def region():
    """Maker of regions: ``region(x, y, width, height, score, kind, **more)``."""
    return change


@pytest.fixture(scope='session')
def ground(texture_of):
    """A textured reference, (120, 160, 3) uint8."""
    return cv2.merge([texture_of(120, 160, seed) for seed in (1, 2, 3)])


@pytest.fixture(scope='session')
def flown(ground):
    """Maker of a report on a dozen frames with two changes, a static object and two losses."""

    def fly(title='Replay of a bag', config=None, frames=12):
        report = FlightReport(title, config) if config else FlightReport(title)
        for n in range(frames):
            lost = n in (4, 7)
            static = change(20, 80, score=0.8, kind='static')
            regions = [] if lost else [static, change(100, 30 + n)][: 1 + (n > 2)]
            if n > 8:
                regions.append(change(50, 20, score=0.5, shadow_like=True))
            reason = 'no overlap: 3% of the frame' if lost else ''
            result = result_of(ground, regions, unknown_left=12, reason=reason)
            report.add(n, START_NS + n * STEP_NS, ground, ground, result)
        return report

    return fly
