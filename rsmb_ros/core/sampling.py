"""The reference, prepared once for fast sampling at any sub-pixel place."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from .workers import Workers, shared

# Half-pixel interpolation, 8 taps; what lies between the half pixels is sampled bilinearly.
HALF_PIXEL_TAPS = np.array([-0.0105, 0.0465, -0.1525, 0.6165], np.float32)
SOFT_SIGMA = 0.7  # px, of the small blur that defocus is made of
HALF_PIXELS = 0.5  # px between two samples of `half_pixel`
_KERNEL = np.concatenate([HALF_PIXEL_TAPS, HALF_PIXEL_TAPS[::-1]]) / (2 * HALF_PIXEL_TAPS.sum())


def half_pixel(image: np.ndarray) -> np.ndarray:
    """
    Interleave an image (M, N) float32 with its half-pixel samples, (2M, 2N) float32.

    Element (2i + a, 2j + b) is the image at (i + a/2, j + b/2); edge values continue outside.
    """
    rows, cols = image.shape
    fine = np.empty((2 * rows, 2 * cols), np.float32)
    fine[0::2, 0::2] = image
    # filter2D correlates with the anchor at tap 3: taps i-3 .. i+4 around i + 1/2
    options = {'borderType': cv2.BORDER_REPLICATE}
    right = cv2.filter2D(image, cv2.CV_32F, _KERNEL[None, :], anchor=(3, 0), **options)
    fine[0::2, 1::2] = right
    below = {'kernel': _KERNEL[:, None], 'anchor': (0, 3), **options}
    fine[1::2, 0::2] = cv2.filter2D(image, cv2.CV_32F, **below)
    fine[1::2, 1::2] = cv2.filter2D(right, cv2.CV_32F, **below)
    return fine


def side_by_side(planes: Sequence[np.ndarray]) -> np.ndarray:
    """
    Arrange the colours (2M, 2N) of a `half_pixel` image for reading rows, (2M, 2, N, C) float32.

    Element (i, b, j, c) is colour c at half pixel (i, 2j + b): neighbouring pixels of a row read
    neighbouring values, whichever the half pixel they begin at.
    """
    rows, columns = planes[0].shape
    out = np.empty((rows, 2, columns // 2, len(planes)), np.float32)
    for c, plane in enumerate(planes):
        out[..., c] = plane.reshape(rows, columns // 2, 2).transpose(0, 2, 1)
    return out


def colour_of(beside: np.ndarray, c: int) -> np.ndarray:
    """Return colour `c` of a `side_by_side` image as `half_pixel` has it, (2M, 2N) float32."""
    rows, _, columns, _ = beside.shape
    return beside[..., c].transpose(0, 2, 1).reshape(rows, 2 * columns)


def planes_of(fine: np.ndarray) -> list[np.ndarray]:
    """Return each colour (2M, 2N) of an image that is `half_pixel` or `side_by_side`."""
    if fine.ndim == 2:
        return [fine]
    return [np.ascontiguousarray(colour_of(fine, c)) for c in range(fine.shape[3])]


def softened(image: np.ndarray, pixel: float) -> np.ndarray:
    """
    Return what defocus of 1 px^2 adds to an image (M, N) float32, a pixel of it being `pixel` px.

    Small blurs add up like their variances, so `image + variance * softened` is a lens that
    blurs by `variance`; see `defocused`.
    """
    blurred = cv2.GaussianBlur(image, (0, 0), SOFT_SIGMA / pixel)
    return (blurred - image) * np.float32(1.0 / SOFT_SIGMA**2)


def defocused(
    image: np.ndarray,
    softer: np.ndarray,
    variance: float,
    executor: Workers | None = None,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """
    Return an image (M, ...) float32 seen through a lens that blurs by `variance` more [px^2].

    `softer` is what `softened` says that 1 px^2 adds; negative variances sharpen. `out`, where
    given, is contiguous and receives the result; threads of an `executor` share the rows.
    """
    if variance == 0.0 and out is None:
        return image
    if out is None:
        out = np.empty_like(image)
    added, seen = softer.reshape(len(image), -1), out.reshape(len(image), -1)
    flat = image.reshape(len(image), -1)

    def run(first: int, last: int) -> None:
        cv2.scaleAdd(added[first:last], variance, flat[first:last], dst=seen[first:last])

    if executor is None:
        run(0, len(image))
    else:
        shared(executor, run, len(image), image.size)
    return out


def pyramid(image: np.ndarray, levels: int) -> list[np.ndarray]:
    """Image (M, N) float32 and its `levels` - 1 halvings by area means, largest first."""
    images = [image]
    for _ in range(levels - 1):
        rows, cols = images[-1].shape
        images.append(
            cv2.resize(
                images[-1][: rows // 2 * 2, : cols // 2 * 2],
                (cols // 2, rows // 2),
                interpolation=cv2.INTER_AREA,
            )
        )
    return images
