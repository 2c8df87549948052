"""
The equations as they stand in the papers, slow and without tricks: the oracle of every kernel.

Nothing here calls the package. Coordinates are full-size pixels, (row, col) images.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.ndimage import spline_filter
from scipy.spatial.transform import Rotation


def path_coordinates(control, first_time, knot_rows, time):
    """Evaluate the uniform cubic B-spline at one time by scipy's general one."""
    knots = len(control)
    last = knots - 3
    s = min(max((time - first_time) / knot_rows, 0.0), last - 1e-6)
    spline = BSpline(np.arange(-3, knots + 1, dtype=float), np.asarray(control, float), 3)
    return spline(s)


def homography(q, focal, half_width, depth=1.0):
    """H = R + T n^T / d between centred pixels for path coordinates q."""
    a_x, a_y, rho, zeta, p_x, p_y = q
    r_x = -np.arctan(p_y * focal / half_width**2)
    r_y = np.arctan(p_x * focal / half_width**2)
    rotation = Rotation.from_rotvec([r_x, r_y, rho / half_width]).as_matrix()
    scale = 1.0 + zeta / half_width
    # T is what takes the centre to (a_x, a_y) and magnifies it by `scale`
    t = np.array([a_x / (focal * scale), a_y / (focal * scale), 1.0 / scale]) - rotation[:, 2]
    plane = rotation + np.outer(t, [0, 0, 1]) / depth
    k = np.diag([focal, focal, 1.0])
    return k @ plane @ np.linalg.inv(k)


def bilinear(image, v, u):
    """Value and gradient (d/du, d/dv) of an image between its pixels."""
    i = min(int(v), image.shape[0] - 2)
    j = min(int(u), image.shape[1] - 2)
    a, b = v - i, u - j
    f = image[i : i + 2, j : j + 2].astype(float)
    top, bottom = f[:, 0] * (1 - b) + f[:, 1] * b
    value = top * (1 - a) + bottom * a
    du = (1 - a) * (f[0, 1] - f[0, 0]) + a * (f[1, 1] - f[1, 0])
    dv = (1 - b) * (f[1, 0] - f[0, 0]) + b * (f[1, 1] - f[0, 1])
    return value, du, dv


def keys(t):
    """Weight of a pixel `t` px away in Keys' bicubic interpolation."""
    t = abs(t)
    if t < 1:
        return 1.5 * t**3 - 2.5 * t**2 + 1
    if t < 2:
        return -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    return 0.0


def b_spline(t):
    """Weight of a coefficient `t` px away in a cubic B-spline."""
    t = abs(t)
    if t < 1:
        return 2 / 3 - t**2 + t**3 / 2
    if t < 2:
        return (2 - t) ** 3 / 6
    return 0.0


def spline(image, v, u):
    """Value of the cubic spline through the pixels of an image (M, N)."""
    return cubic(spline_filter(image.astype(float), mode='mirror'), v, u, b_spline)


def cubic(image, v, u, weight):
    """Sum of what is near (v, u), mirrored at the edges; beyond them the edge goes on."""
    rows, cols = image.shape
    v, u = min(max(v, 0.0), rows - 1.0), min(max(u, 0.0), cols - 1.0)
    total = 0.0
    for i in range(int(v) - 1, int(v) + 3):
        for j in range(int(u) - 1, int(u) + 3):
            mirrored = min(abs(i), 2 * rows - 2 - abs(i)), min(abs(j), 2 * cols - 2 - abs(j))
            total += weight(v - i) * weight(u - j) * image[mirrored]
    return total


def warped_place(h, x, y, center):
    """Place (u, v) in the reference of live pixel (x, y)."""
    u, v, w = h @ np.array([x - center[0], y - center[1], 1.0])
    return u / w + center[2], v / w + center[3]


def blurred_row(fine, path, row, count, depth=1.0):
    """Eq. 1: mean over `count` instants of the warped half-pixel reference; NaN outside."""
    grid = path.grid
    out = np.zeros(grid.live_shape[1])
    for k in range(count):
        time = path.row_times[row] + instants(count)[k] * path.exposure_rows
        q = path_coordinates(path.control, path.first_time, path.knot_rows, time)
        h = homography(q, grid.focal_px, grid.half_width, depth)
        for x in range(grid.live_shape[1]):
            u, v = warped_place(h, x, row, grid.center)
            inside = 0 <= 2 * u <= fine.shape[1] - 2 and 0 <= 2 * v <= fine.shape[0] - 2
            out[x] += bilinear(fine, 2 * v, 2 * u)[0] / count if inside else np.nan
    return out


def display(linear, gamma):
    """Tone curve of the camera."""
    return 255.0 * (max(linear, 0.25) / 255.0) ** (1.0 / gamma)


def instants(count):
    """Places in an exposure, equally far apart, whose variance is that of the exposure, 1/12."""
    places = np.arange(count) - (count - 1) / 2
    return places * np.sqrt(1 / 12 / np.mean(places**2))


def point_residual(fine, path, row, column, value, count, light, gamma, depth=1.0):
    """Eq. 1 and 6 for one point: live display value minus the predicted one; None outside."""
    grid = path.grid
    mean = 0.0
    for k in range(count):
        time = path.row_times[row] + instants(count)[k] * path.exposure_rows
        q = path_coordinates(path.control, path.first_time, path.knot_rows, time)
        h = homography(q, grid.focal_px, grid.half_width, depth)
        u, v = warped_place(h, column, row, grid.center)
        if not (0 <= 2 * u <= fine.shape[1] - 2.001 and 0 <= 2 * v <= fine.shape[0] - 2.001):
            return None
        mean += bilinear(fine, 2 * v, 2 * u)[0] / count
    x = (column - grid.center[0]) / grid.half_width
    y = (row - grid.center[1]) / grid.half_width
    gain = light[0] + light[1] * x + light[2] * y + light[3] * (x * x + y * y)
    return value - display(gain * mean + light[4], gamma)


def layer_place(path, row, column, share, depth):
    """Where the layer at `depth` puts a live pixel at a share (-1/2..1/2) of its row's exposure."""
    grid = path.grid
    time = path.row_times[row] + share * path.exposure_rows
    q = path_coordinates(path.control, path.first_time, path.knot_rows, time)
    return warped_place(
        homography(q, grid.focal_px, grid.half_width, depth), column, row, grid.center
    )


def composited(fine, masks, depths, path, row, column, count):
    """Eq. 5: mean light of a pixel over what is known, and how much is; nearest layer first."""
    light = known = 0.0
    rows, cols = masks[0].shape
    for share in instants(count):
        left = 1.0
        for mask, depth in zip(masks, depths, strict=True):
            u, v = layer_place(path, row, column, share, depth)
            if 0 <= u <= cols - 1 and 0 <= v <= rows - 1:
                part = min(bilinear(mask, v, u)[0], left)
                if part > 0:
                    light += part * bilinear(fine, 2 * v, 2 * u)[0] / count
                known += part / count
                left -= part
    return light / known if known else 0.0, known


def surface_light(fine, surface, path, row, column, count):
    """Light of a pixel that shows one surface (M, N) of 1/d without edges, all of it known."""
    light = 0.0
    for share in instants(count):
        inverse = 1.0
        for _ in range(30):  # the point that lies where its own depth puts it
            u, v = layer_place(path, row, column, share, 1.0 / inverse)
            inverse = surface[round(v), round(u)]
        light += bilinear(fine, 2 * v, 2 * u)[0] / count
    return light


def seen_depth(surface, even, masks, depths, path, row, column, count, most):
    """Mean 1/d that a point sees over the exposure; 0 at edges, and where it differs too much."""
    seen = []
    for share in instants(count):
        found = 0.0
        for mask, depth in zip(masks, depths, strict=True):
            u, v = layer_place(path, row, column, share, depth)
            i, j = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
            if 0 <= i < surface.shape[0] and 0 <= j < surface.shape[1] and mask[i, j]:
                found = surface[i, j] if even[i, j] else 0.0
                break
        seen.append(found)
    return float(np.mean(seen)) if min(seen) > 0 and max(seen) - min(seen) <= most else 0.0


def strongest_gradients(image, rows, bins):
    """Column of the strongest gradient in each bin of each row."""
    out = np.zeros((len(rows), bins), int)
    for r, y in enumerate(rows):
        for b in range(bins):
            best = -1.0
            begin, end = (n * image.shape[1] // bins for n in (b, b + 1))
            for x in range(max(1, begin), min(image.shape[1] - 1, end)):
                above, below = max(y - 1, 0), min(y + 1, image.shape[0] - 1)
                strength = abs(image[y, x + 1] - image[y, x - 1]) + abs(
                    image[below, x] - image[above, x]
                )
                if strength > best:
                    best, out[r, b] = strength, x
    return out


def live_place(homographies, u, v, center):
    """Where the live frame shows reference pixel (u, v): search the rows for the one that fits."""
    best = None
    for row, h in enumerate(homographies):
        x, y, w = np.linalg.inv(h) @ np.array([u - center[2], v - center[3], 1.0])
        x, y = x / w + center[0], y / w + center[1]
        if best is None or abs(y - row) < best[0]:
            best = abs(y - row), x, y
    return best


def row_sums(predicted, residual, judged, ends, variance, misplaced2, outlier2):
    """Tukey-weighted normal equations of a shift of each row, and its misfit (M, 2, 6)."""
    rows, columns = predicted.shape
    sums = np.zeros((rows, 2, 6))
    for i in range(rows):
        for j in range(1, columns - 1):
            if not judged[i, j]:
                continue
            half = int(np.searchsorted(ends, j, side='right')) % 2
            g_x = (float(predicted[i, j + 1]) - predicted[i, j - 1]) / 2
            below, above = min(i + 1, rows - 1), max(i - 1, 0)
            g_y = (float(predicted[below, j]) - predicted[above, j]) / 2
            r = float(residual[i, j])
            own = variance + misplaced2 * (g_x**2 + g_y**2)
            near = max(0.0, 1.0 - r**2 / (outlier2 * own))
            weight = near**2 / own
            terms = weight * np.array([g_x * g_x, g_x * g_y, g_y * g_y, g_x * r, g_y * r, 0.0])
            terms[5] = 1.0 - near**3
            sums[i, half] += terms
    return sums
