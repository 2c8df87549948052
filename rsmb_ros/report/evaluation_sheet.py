"""One case of an evaluation on one sheet: the pictures, and what is found against the truth."""

from __future__ import annotations

import cv2
import numpy as np

from .drawing import captioned, to_bgr
from .sheet import contact_sheet

# Okabe and Ito (2008): told apart with any colour vision, and by brightness in print. BGR.
FOUND = (115, 158, 0)  # bluish green
FALSE_ALARM = (0, 94, 213)  # vermillion
MISSED = (66, 228, 240)  # yellow
IGNORED = (150, 150, 150)
NOT_JUDGED = (45, 40, 40)
LEGEND = {
    'found': FOUND,
    'false alarm': FALSE_ALARM,
    'missed': MISSED,
    'ignored': IGNORED,
    'not judged': NOT_JUDGED,
}
_KEPT = 0.35  # share of the picture that stays to be seen under a colour
_LEGEND_ROWS = 14  # px


def case_sheet(
    title: str,
    reference: np.ndarray,
    live: np.ndarray,
    registered: np.ndarray | None,
    change: np.ndarray,
    valid: np.ndarray,
    label: np.ndarray,
) -> np.ndarray:
    """
    Show reference, live, registered and the found against the true changes, with a legend.

    Parameters
    ----------
    title : str
        Written above, ASCII.
    reference, live : ndarray of shape (M', N'[, 3]) and (M, N[, 3]), uint8
        Grey or BGR.
    registered : ndarray of shape (M, N[, 3]), uint8 or float32, or None
        Display values 0..255, grey or BGR; None: not registered.
    change, valid : ndarray of shape (M, N), bool
        Reported as changed; judged.
    label : ndarray of shape (M, N), uint8
        255 changed, 0 not; 170 (rim) and 85 (outside) are ignored.

    Returns
    -------
    ndarray of shape (M'', N'', 3), uint8
        BGR.

    """
    if registered is None:
        third = {'not registered': np.full(live.shape[:2], 128, np.uint8)}
    else:
        known = np.nan_to_num(registered)  # outside the reference a method may leave anything
        third = {'registered': np.clip(np.rint(known), 0, 255).astype(np.uint8)}
    sheet = contact_sheet(
        {
            'reference': reference,
            'live': live,
            **third,
            'found against true': draw_truth(live, change, valid, label),
        }
    )
    return captioned(np.vstack([sheet, _legend(sheet.shape[1])]), title)


def draw_truth(
    live: np.ndarray, change: np.ndarray, valid: np.ndarray, label: np.ndarray
) -> np.ndarray:
    """
    Colour the live image by what is found, missed and wrongly reported.

    Parameters
    ----------
    live : ndarray of shape (M, N) or (M, N, 3), uint8
        Grey or BGR.
    change, valid : ndarray of shape (M, N), bool
        Reported as changed, what is not valid does not count; judged.
    label : ndarray of shape (M, N), uint8
        255 changed, 0 not; 170 (rim) and 85 (outside) are ignored.

    Returns
    -------
    ndarray of shape (M, N, 3), uint8
        BGR, colours as in `LEGEND`.

    """
    picture = to_bgr(live if live.ndim == 2 else cv2.cvtColor(live, cv2.COLOR_BGR2GRAY))
    changed, ignored = label == 255, np.isin(label, (85, 170))
    reported = change & valid
    kinds = (
        (~valid, NOT_JUDGED),
        (changed & reported, FOUND),
        (changed & ~reported, MISSED),  # also where it was not judged
        (~changed & reported, FALSE_ALARM),
        (ignored, IGNORED),
    )
    paint = picture.astype(np.float32)
    for where, color in kinds:
        paint[where] = color
    return np.rint(_KEPT * picture + (1 - _KEPT) * paint).astype(np.uint8)


def _legend(cols: int) -> np.ndarray:
    """Return a strip of `cols` px with all colours and their names."""
    width = cols // len(LEGEND)
    tiles = [
        captioned(np.full((_LEGEND_ROWS, width, 3), color, np.uint8), name)
        for name, color in LEGEND.items()
    ]
    rest = cols - width * len(LEGEND)
    return cv2.copyMakeBorder(np.hstack(tiles), 0, 0, 0, rest, cv2.BORDER_REPLICATE)
