"""Rows of the reference as single poses see them (Eq. 2, 6), and their blend (Eq. 1)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .geometry import INLINED, OPTIONS, rotation

UNSEEN = -1e6  # value of a warped pixel that lies outside the reference


@njit(inline='always', **OPTIONS)
def bilinear(fine, half_rows, half_columns, u, v):
    """Return the half-pixel reference at column `u`, row `v` [half pixels], which must be in it."""
    # the last sample of a row or column has no right neighbour: step back one
    iu = min(int(u), half_columns - 2)
    iv = min(int(v), half_rows - 2)
    f_u = np.float32(u - iu)
    f_v = np.float32(v - iv)
    at = iv * half_columns + iu
    f00 = fine[at]
    f10 = fine[at + half_columns]
    top = f00 + f_u * (fine[at + 1] - f00)
    bottom = f10 + f_u * (fine[at + half_columns + 1] - f10)
    return top + f_v * (bottom - top)


@njit(**INLINED)
def pose_homography(pose, focal, inverse_depth, out):
    """Write H = K (R + T n^T / d) K^-1 between centred pixels for tau = `pose` (Eq. 2)."""
    rotation(math.radians(pose[4]), math.radians(pose[5]), math.radians(pose[2]), out)
    part = inverse_depth / pose[3]  # of t = f T s
    out[2] = out[2] * focal + pose[0] * part
    out[5] = out[5] * focal + pose[1] * part
    out[6] /= focal
    out[7] /= focal
    out[8] += part - inverse_depth


@njit(**OPTIONS)
def warp_rows(rows, stride, poses, fine, half_rows, half_columns, focal, center, out, counts):
    """
    Write F (K, R n): live rows `rows` (R,) of the reference seen from `poses` (K, 6) (Eq. 6).

    `fine` is the flat half-pixel reference; a row is its pixels 0, `stride`, 2 `stride`... What a
    pose sees outside is UNSEEN; `counts` (K,) receives the pixels it sees inside.
    """
    h = np.empty(9)
    size = out.shape[1] // rows.size
    u_limit = half_columns - 2.0
    v_limit = half_rows - 2.0
    for k in range(poses.shape[0]):
        pose_homography(poses[k], focal, 1.0, h)
        inside = 0
        for r in range(rows.size):
            y = rows[r] - center[1]
            a0 = h[1] * y + h[2]
            b0 = h[4] * y + h[5]
            c0 = h[7] * y + h[8]
            start = r * size
            for x in range(size):
                xc = x * stride - center[0]
                w = 1.0 / (c0 + h[6] * xc)
                u = 2.0 * ((a0 + h[0] * xc) * w + center[2])
                v = 2.0 * ((b0 + h[3] * xc) * w + center[3])
                if u < 0.0 or v < 0.0 or u > u_limit or v > v_limit:
                    out[k, start + x] = UNSEEN
                    continue
                inside += 1
                out[k, start + x] = bilinear(fine, half_rows, half_columns, u, v)
        counts[k] = inside


@njit(**OPTIONS)
def drop_unseen(columns, counts, enough, live, known):
    """
    Leave out poses that see fewer than `enough` pixels, then pixels that any other sees outside.

    What is left out becomes 0 in `columns` (K, n) and `live` (n,): it then weighs nothing.
    """
    n = columns.shape[1]
    for x in range(n):
        known[x] = True
    for k in range(columns.shape[0]):
        if enough <= counts[k] < n:
            for x in range(n):
                if columns[k, x] == UNSEEN:
                    known[x] = False
    complete = True
    for x in range(n):
        if not known[x]:
            complete = False
            live[x] = 0.0
    for k in range(columns.shape[0]):
        if counts[k] < enough:
            for x in range(n):
                columns[k, x] = 0.0
        elif not complete:
            for x in range(n):
                if not known[x]:
                    columns[k, x] = 0.0


@njit(**OPTIONS)
def blend_rows(
    first, last, fine, half_rows, half_columns, poses, weights, focal, center, inverse_depth, out,
    complete,
):
    """Write rows first..last-1 of sum_k w_k F_k (Eq. 1); complete where every pose sees inside."""
    h = np.empty(9)
    u_limit = half_columns - 2.0
    v_limit = half_rows - 2.0
    for i in range(first, last):
        y = i - center[1]
        for x in range(out.shape[1]):
            out[i, x] = 0.0
            complete[i, x] = True
        for k in range(poses.shape[1]):
            share = np.float32(weights[i, k])
            if share == 0.0:
                continue
            pose_homography(poses[i, k], focal, inverse_depth, h)
            a0 = h[1] * y + h[2]
            b0 = h[4] * y + h[5]
            c0 = h[7] * y + h[8]
            for x in range(out.shape[1]):
                xc = x - center[0]
                w = 1.0 / (c0 + h[6] * xc)
                u = 2.0 * ((a0 + h[0] * xc) * w + center[2])
                v = 2.0 * ((b0 + h[3] * xc) * w + center[3])
                if u < 0.0 or v < 0.0 or u > u_limit or v > v_limit:
                    complete[i, x] = False
                    continue
                out[i, x] += share * bilinear(fine, half_rows, half_columns, u, v)
        for x in range(out.shape[1]):
            if not complete[i, x]:
                out[i, x] = 0.0
