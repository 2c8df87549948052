"""The live image with everything the detector has to say drawn into it."""

from __future__ import annotations

import cv2
import numpy as np

from rsmb_ros.core.types import REGISTERED, Result

from .drawing import label, line_width, status_line, to_bgr

CHANGE = (40, 40, 255)  # BGR, red
STATIC = (60, 200, 60)  # green
_UNKNOWN_TINT = np.array((110, 80, 55), np.float32)  # blue-grey, also readable without colour
_UNKNOWN_KEPT = 0.45  # share of the picture that stays under the tint
_HATCH_EVERY = 12  # line widths


def draw_overlay(live: np.ndarray, result: Result) -> np.ndarray:
    """
    Draw regions, unknown pixels and one line of status into the live image.

    Changes are outlined in red with their score, static objects boxed in green with their
    relative depth; pixels that were not judged are dark, blue-grey and hatched.

    Parameters
    ----------
    live : ndarray of shape (M, N) or (M, N, 3), uint8
    result : Result
        For this very frame.

    Returns
    -------
    ndarray of shape (M, N, 3), uint8
        BGR.

    """
    picture = to_bgr(live)
    _hatch(picture, result.valid_mask == 0)
    width = line_width(picture)
    outlines, _ = cv2.findContours(result.change_mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(picture, outlines, -1, CHANGE, width)
    for region in result.regions:
        corner = (region.x, region.y)
        if region.kind == 'change':
            label(picture, f'{region.score:.2f}', corner, CHANGE)
        else:
            far = (region.x + region.width - 1, region.y + region.height - 1)
            cv2.rectangle(picture, corner, far, STATIC, width)
            label(picture, f'depth {region.relative_depth:.2f}', corner, STATIC)
    status_line(picture, describe(result))
    return picture


def describe(result: Result) -> str:
    """Return the result in one short line of ASCII."""
    if result.status != REGISTERED:
        return f'not registered: {result.reason}'
    changes = len(result.changes)
    statics = len(result.regions) - changes
    return (
        f'registered | {_count(changes, "change")} | {_count(statics, "static object")} '
        f'| exposure {result.exposure_rows:.0f} rows'
    )


def _count(number: int, noun: str) -> str:
    return f'{number} {noun}' + ('' if number == 1 else 's')


def _hatch(picture: np.ndarray, unknown: np.ndarray) -> None:
    """Darken the pixels in `unknown` and draw diagonal lines over them."""
    width = line_width(picture)
    rows, cols = np.ogrid[: unknown.shape[0], : unknown.shape[1]]
    lines = (rows + cols) % (_HATCH_EVERY * width) < width
    tinted = _UNKNOWN_KEPT * picture[unknown] + (1 - _UNKNOWN_KEPT) * _UNKNOWN_TINT
    picture[unknown] = tinted.astype(np.uint8)
    picture[unknown & lines] = _UNKNOWN_TINT.astype(np.uint8)
