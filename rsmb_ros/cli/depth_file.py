"""Depth maps from files, as ``--depth`` takes them."""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import cv2
import numpy as np

from rsmb_ros.core.errors import ConfigError, FileProblem

from .options import within


def add_depth_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--depth`` and ``--depth-unit``."""
    parser.add_argument(
        '--depth',
        type=Path,
        metavar='FILE',
        help='depth of each reference pixel over that of the background: .npy, TIFF of floats (NaN '
        '= unknown), PNG or TIFF of integers (0 = unknown); replaces the search for layers',
    )
    parser.add_argument(
        '--depth-unit',
        type=within(float, 1e-9, 1e3),
        metavar='VALUE',
        help='relative depth of the value 1 in the file: 1 for floats, must be given for integers; '
        '0.02 for metres over ground 50 m away',
    )


def load_depth(args: argparse.Namespace) -> np.ndarray | None:
    """
    Return the relative depth (M, N) float32 that `args` ask for, None without ``--depth``.

    Raises
    ------
    ConfigError
        If the unit is missing, or there is one without a file.
    FileProblem
        If the file cannot be read or holds no depth.

    """
    if args.depth is None:
        if args.depth_unit is not None:
            raise ConfigError('--depth-unit is nothing without --depth FILE')
        return None
    values = _values(args.depth)
    if values.ndim != 2 or values.dtype.kind not in 'fui':
        raise FileProblem(
            f'{args.depth}: holds {values.dtype} {values.shape}, must be floats or integers of '
            'shape (rows, columns)'
        )
    if values.dtype.kind == 'f':
        return (values * (args.depth_unit or 1.0)).astype(np.float32)
    if args.depth_unit is None:
        raise ConfigError(
            f'{args.depth}: holds {values.dtype}; --depth-unit must say what depth, over that of '
            'the background, the value 1 means'
        )
    depth = (values * args.depth_unit).astype(np.float32)
    depth[values == 0] = np.nan
    return depth


def _values(path: Path) -> np.ndarray:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileProblem(f'{path}: cannot be read: {error.strerror}') from error
    if path.suffix == '.npy':
        try:
            return np.load(io.BytesIO(data), allow_pickle=False)
        except (ValueError, EOFError) as error:
            raise FileProblem(f'{path}: not a .npy file of numbers: {error}') from error
    try:
        values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:  # empty, or a kind this OpenCV was built without
        values = None
    if values is None:
        raise FileProblem(
            f'{path}: not a depth map this OpenCV can read; must be .npy, PNG or TIFF'
        )
    return values
