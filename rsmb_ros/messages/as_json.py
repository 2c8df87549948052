"""A result as plain values that JSON can hold; unknown numbers are null."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

from rsmb_ros.core.types import MOTION_COLUMNS, MOTION_UNITS, Result

from .stamps import NS_PER_S


def result_to_dict(
    result: Result, stamp: Any | None = None, frame_id: str | None = None
) -> dict[str, Any]:
    """
    Return everything but the pictures: the summary and the motion of each row.

    Parameters
    ----------
    result : Result
    stamp : builtin_interfaces/Time, optional
        Written as sec and nanosec, exact.
    frame_id : str, optional

    """
    summary = summary_to_dict(result, stamp, frame_id)
    return {**summary, 'row_motion': _row_motion(result)}


def summary_to_dict(
    result: Result, stamp: Any | None = None, frame_id: str | None = None
) -> dict[str, Any]:
    """Return `result_to_dict` without the list of rows: what ``~/regions_json`` carries."""
    summary: dict[str, Any] = {}
    if stamp is not None:
        summary['stamp'] = {'sec': int(stamp.sec), 'nanosec': int(stamp.nanosec)}
    if frame_id is not None:
        summary['frame_id'] = frame_id
    return summary | {
        'status': result.status,
        'reason': result.reason,
        'exposure_rows': _number(result.exposure_rows),
        'gain': _number(result.gain),
        'regions': [_region(region) for region in result.regions],
        'timings_ms': {step: _number(ms) for step, ms in result.timings_ms.items()},
    }


def to_json(values: dict[str, Any]) -> str:
    """Return strict JSON on one line."""
    return json.dumps(values, allow_nan=False)


def _region(region: Any) -> dict[str, Any]:
    values = dataclasses.asdict(region)
    box = {name: int(values.pop(name)) for name in ('x', 'y', 'width', 'height')}
    return {
        'bounding_box': box,
        'area_px': int(region.area),
        'kind': region.kind,
        'relative_depth': _number(region.relative_depth),
        'score': _number(region.score),
        'id': region.id,
        'first_seen': None if region.first_seen is None else _time(region.first_seen),
        'reference_x': _number(region.reference_x),
        'reference_y': _number(region.reference_y),
        'shadow_like': region.shadow_like,
    }


def _row_motion(result: Result) -> list[dict[str, float | None]]:
    names = [
        name if unit == '1' else f'{name}_{unit}'
        for name, unit in zip(MOTION_COLUMNS, MOTION_UNITS, strict=True)
    ] + ['uncertainty_px']
    return [
        dict(zip(names, map(_number, (*row, uncertainty)), strict=True))
        for row, uncertainty in zip(result.row_motion, result.row_uncertainty, strict=True)
    ]


def _time(stamp: int) -> dict[str, int]:
    sec, nanosec = divmod(stamp, NS_PER_S)
    return {'sec': sec, 'nanosec': nanosec}


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
