"""Forward model: one layer seen through a path, bicubic, unlike the estimator's own sampling."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import OPTIONS


@njit(inline='always', **OPTIONS)
def cubic(t, out):
    """Write the four Keys (a = -1/2) weights at fraction `t`."""
    out[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    out[1] = (1.5 * t - 2.5) * t * t + 1.0
    out[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    out[3] = (0.5 * t - 0.5) * t * t


@njit(**OPTIONS)
def warp_row(image, h, row, center, out):
    """
    Write row `row` of `image` (rows, cols, channels) seen through the homography `h` (9,).

    `center` = live centre x, y and the image's own place of the reference centre x, y. Edge values
    continue outside.
    """
    rows, cols, channels = image.shape
    w_x = np.empty(4)
    w_y = np.empty(4)
    y = row - center[1]
    for x in range(out.shape[0]):
        xc = x - center[0]
        w = 1.0 / (h[6] * xc + h[7] * y + h[8])
        u = (h[0] * xc + h[1] * y + h[2]) * w + center[2]
        v = (h[3] * xc + h[4] * y + h[5]) * w + center[3]
        u = min(max(u, 0.0), cols - 1.0)
        v = min(max(v, 0.0), rows - 1.0)
        j = min(int(u), cols - 2)
        i = min(int(v), rows - 2)
        cubic(u - j, w_x)
        cubic(v - i, w_y)
        for c in range(channels):
            total = 0.0
            for m in range(4):
                im = min(max(i + m - 1, 0), rows - 1)
                line = 0.0
                for n in range(4):
                    jn = min(max(j + n - 1, 0), cols - 1)
                    line += w_x[n] * image[im, jn, c]
                total += w_y[m] * line
            out[x, c] = total
