"""Display values of linear light, many at once."""

from __future__ import annotations

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS

# log2(1 + m) / m for sqrt(1/2) <= 1 + m < sqrt(2), and 2^r for |r| <= 1/2: fitted at Chebyshev
# nodes, so that display values are off by .0015 grey levels at most
LOG = tuple(
    np.float32(c)
    for c in (1.44270180, -0.72120847, 0.47979388, -0.36641326, 0.31840711, -0.20685812)
)
EXP = tuple(
    np.float32(c) for c in (1.00000008, 0.69312103, 0.24022107, 0.05592204, 0.00967604)
)
L0, L1, L2, L3, L4, L5 = LOG
E0, E1, E2, E3, E4 = EXP
ROOT = np.int32(0x3F3504F3)  # bits of sqrt(1/2)
MANTISSA = np.int32(0x7FFFFF)  # bits of a float32 below its exponent ...
PLACES = np.int32(23)  # ... so many
FULL = np.float32(255.0)
DARK = np.float32(1e-30)  # of full light: 0 has no logarithm


@njit(inline='always', **OPTIONS)
def power(x, exponent):
    """Return x^exponent for DARK <= x <= 1, 0 < exponent <= 1, float32; off by 6e-6 at most."""
    above = np.float32(x).view(np.int32) - ROOT
    m = np.int32((above & MANTISSA) + ROOT).view(np.float32) - np.float32(1.0)
    log = m * (L0 + m * (L1 + m * (L2 + m * (L3 + m * (L4 + m * L5)))))
    y = exponent * (np.float32(above >> PLACES) + log)
    whole = np.int32(y - np.float32(0.5))  # y <= 0, and integers are cut towards 0
    r = y - np.float32(whole)
    part = np.float32(E0 + r * (E1 + r * (E2 + r * (E3 + r * E4))))
    return np.int32(part.view(np.int32) + (whole << PLACES)).view(np.float32)


@njit(**INLINED)
def show_row(sums, pixel, x0, y, half_width, gain, bias, gamma, weights, grey, shown):
    """
    Write what the live camera shows of a row of linear light (`photometric.Light.apply`).

    `sums` (columns * colours,) is the light, and the worse for it; `shown` gets display values,
    rounded, and `grey` (columns,) their mixture by `weights`. The row begins at `x0`, `y` from the
    image centre [px]; `pixel` holds which pixel a value belongs to, None: there is one colour.
    """
    scale = np.float32(1.0 / half_width)
    begin = np.float32(x0 / half_width)
    yy = y / half_width
    # a_0 + a_1 x + a_2 y + a_3 (x^2 + y^2), as a parabola over x
    a0 = np.float32(gain[0] + gain[2] * yy + gain[3] * yy * yy)
    a1 = np.float32(gain[1])
    a2 = np.float32(gain[3])
    bias = np.float32(bias)
    exponent = np.float32(1.0 / gamma)
    # one of the two is compiled: a kernel that holds both is not vectorised well
    if pixel is None:
        for k in range(np.uint64(grey.size)):
            x = begin + np.float32(np.int32(k)) * scale
            light = sums[k] * (a0 + x * (a1 + x * a2)) + bias
            share = min(max(light / FULL, DARK), np.float32(1.0))
            grey[k] = FULL * power(share, exponent)
        for k in range(np.uint64(grey.size)):
            shown[k] = np.uint8(np.int32(grey[k] + np.float32(0.5)))
    else:
        three = np.uint64(3)
        one = np.uint64(1)
        w0 = weights[0]
        w1 = weights[1]
        w2 = weights[2]
        for k in range(np.uint64(shown.size)):
            x = begin + pixel[k] * scale
            light = sums[k] * (a0 + x * (a1 + x * a2)) + bias
            share = min(max(light / FULL, DARK), np.float32(1.0))
            sums[k] = FULL * power(share, exponent)
        for k in range(np.uint64(shown.size)):
            shown[k] = np.uint8(np.int32(sums[k] + np.float32(0.5)))
        for k in range(np.uint64(grey.size)):
            n = three * k
            grey[k] = w0 * sums[n] + w1 * sums[n + one] + w2 * sums[n + one + one]
