"""What a detector is given: refused where nothing can be done with it."""

from __future__ import annotations

import numpy as np

from .config import Config
from .depth_map import DepthMap, checked_depth
from .errors import ConfigError, FrameError

MIN_SIZE = 32  # px, smaller frames hold nothing to register by


def checked_image(image: np.ndarray, name: str) -> np.ndarray:
    """
    Return an image that can be worked on; raises FrameError if it is none.

    A copy where rows do not follow each other or nothing may be written: kernels are compiled for
    those that may.
    """
    ok = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not ok or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        known = isinstance(image, np.ndarray)
        what = f'{image.dtype} {image.shape}' if known else type(image).__name__
        raise FrameError(f'{name} is {what}, must be uint8 of shape (M, N) or (M, N, 3) in BGR')
    if min(image.shape[:2]) < MIN_SIZE:
        raise FrameError(
            f'{name} is {image.shape[0]}x{image.shape[1]} px, '
            f'must be at least {MIN_SIZE}x{MIN_SIZE}'
        )
    return np.require(image, requirements=['C', 'W'])


def checked_layers(depth: np.ndarray, reference: np.ndarray, config: Config) -> DepthMap:
    """Return the layers of a known depth; only the path estimator takes them."""
    if config.registration.estimator == 'rows':
        raise ConfigError(
            'registration.estimator = rows takes no depth map: must be path, or give no depth'
        )
    return DepthMap(checked_depth(depth, reference.shape))
