"""The report's own estimator, each row alone, on the papers' frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rsmb_ros.core import Camera, Config, Detector, warm_up

from ..suites import SUITES, Wish
from .timing import Times, time_ours

SUITE = SUITES['authors']
DOF = 3


@dataclass(frozen=True)
class RowTimes:
    """Rows of one frame solved one by one."""

    shape: tuple[int, int]
    case: str
    times: Times


def row_times(config: Config, count: int) -> Iterator[RowTimes]:
    """Time the first `count` cases of the suite `authors`, their references prepared."""
    config = config.replaced(
        {
            **SUITE.settings,
            'registration.estimator': 'rows',
            'registration.degrees_of_freedom': DOF,
        }
    )
    warm_up(config)
    for case in SUITE.cases(Wish(first=count)):
        camera = Camera(case.focal_px) if case.focal_px else None
        detector = Detector(case.reference, camera, config)
        detector.detect(case.live)
        times, _ = time_ours(detector, case.live)
        shape = case.live.shape[0], case.live.shape[1]
        yield RowTimes(shape, case.name, times)
