"""What the residuals of a path fit say together."""

from __future__ import annotations

from numba import njit

from .geometry import INLINED


@njit(**INLINED)
def spread(residuals, none, limit, least_seen, bins, per_level, seen):
    """
    Return the median of |residuals| (R, P), their mean cut off at `limit`, and the share that is.

    Residuals above `none` are none. `bins` (n,) is room to count in, `per_level` bins a grey level;
    `seen` (R,) gets whether more than a share `least_seen` of a row's points are.
    """
    bins[:] = 0
    last = bins.size - 1
    count = 0
    total = 0.0
    for r in range(residuals.shape[0]):
        known = 0
        for p in range(residuals.shape[1]):
            size = abs(residuals[r, p])
            if size < none:
                known += 1
                bins[min(int(size * per_level), last)] += 1
                total += min(size, limit)
        seen[r] = known > least_seen * residuals.shape[1]
        count += known
    if count == 0:
        return 0.0, 0.0, 0.0
    half = 0.5 * count
    below = 0
    k = 0
    while below + bins[k] < half:
        below += bins[k]
        k += 1
    median = (k + (half - below) / bins[k]) / per_level
    return median, total / count, count / residuals.size
