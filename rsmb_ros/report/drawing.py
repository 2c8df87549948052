"""Lines and text in sizes that suit the picture, from 320 to some thousand pixels."""

from __future__ import annotations

import cv2
import numpy as np

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_WHITE = (255, 255, 255)
_BLACK = (0, 0, 0)


def to_bgr(image: np.ndarray) -> np.ndarray:
    """Return a copy of a grey or BGR image as BGR, (M, N, 3) uint8."""
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()


def line_width(picture: np.ndarray) -> int:
    """Return the width of a line [px]: 2 at 640x480, 3 at 1600x900."""
    return max(1, round(_size(picture) / 300))


def label(
    picture: np.ndarray, text: str, corner: tuple[int, int], color: tuple[int, int, int]
) -> None:
    """Write `text` on a dark ground above `corner` (x, y), moved to stay in the picture."""
    width, height, pad = _text_size(picture, text)
    x = min(max(corner[0], 0), max(picture.shape[1] - width - 2 * pad, 0))
    y = max(corner[1] - height - 3 * pad, 0)
    _text_box(picture, text, x, y, color)


def status_line(picture: np.ndarray, text: str) -> None:
    """Write `text` into the lower left corner, cut off where it would not fit."""
    while len(text) > 4 and _text_size(picture, text)[0] > 0.97 * picture.shape[1]:
        text = text.removesuffix('...')[:-1] + '...'
    _, height, pad = _text_size(picture, text)
    _text_box(picture, text, 0, picture.shape[0] - height - 3 * pad, _WHITE)


def captioned(picture: np.ndarray, text: str) -> np.ndarray:
    """Return the picture with `text` in a dark bar above it."""
    _, height, pad = _text_size(picture, text)
    bar = np.full((height + 5 * pad, picture.shape[1], 3), 32, np.uint8)
    cv2.putText(bar, text, (2 * pad, height + 2 * pad), _FONT, *_style(picture, _WHITE))
    return np.vstack([bar, picture])


def _text_box(picture: np.ndarray, text: str, x: int, y: int, color: tuple[int, int, int]) -> None:
    width, height, pad = _text_size(picture, text)
    cv2.rectangle(picture, (x, y), (x + width + 2 * pad, y + height + 3 * pad), _BLACK, -1)
    # a red on black is hard to read for some: the text is white, its ground is framed in colour
    cv2.rectangle(picture, (x, y), (x + width + 2 * pad, y + height + 3 * pad), color, 1)
    origin = (x + pad, y + height + pad)
    cv2.putText(picture, text, origin, _FONT, *_style(picture, _WHITE))


def _size(picture: np.ndarray) -> float:
    return float(np.sqrt(picture.shape[0] * picture.shape[1]))


def _style(
    picture: np.ndarray, color: tuple[int, int, int]
) -> tuple[float, tuple[int, int, int], int, int]:
    scale = max(0.35, 0.45 * (_size(picture) / 554) ** 0.7)  # 554: 640x480
    return scale, color, max(1, round(1.6 * scale)), cv2.LINE_AA


def _text_size(picture: np.ndarray, text: str) -> tuple[int, int, int]:
    """Return width and height of `text` and the space around it [px]."""
    scale, _, thickness, _ = _style(picture, _WHITE)
    (width, height), _ = cv2.getTextSize(text, _FONT, scale, thickness)
    return width, height, max(2, round(6 * scale))
