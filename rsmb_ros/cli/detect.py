"""`rsmb detect`: one pair of image files."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

import rsmb_ros
from rsmb_ros.bags.image_files import read_image
from rsmb_ros.core import Config, Detector
from rsmb_ros.core.types import Result
from rsmb_ros.messages.as_json import result_to_dict
from rsmb_ros.report.overlay import describe, draw_overlay

from .depth_file import add_depth_options, load_depth
from .images import output_folder, write_png, write_whole
from .options import add_config_options, load_config


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.epilog = (
        'Writes change_mask.png, valid_mask.png, registered.png, rectified.png, overlay.png, '
        'residual.png (grey level 128 + live - registered, clipped to 0..255) and result.json.'
    )
    parser.add_argument('reference', type=Path, help='clean image, JPEG or PNG')
    parser.add_argument('live', type=Path, help='image to examine, JPEG or PNG')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR')
    add_depth_options(parser)
    add_config_options(parser)


def run(args: argparse.Namespace) -> int:
    """Compare, write, say in one line what came out."""
    config = load_config(args).for_one_frame()
    detector = Detector(read_image(args.reference), config=config, depth=load_depth(args))
    live = read_image(args.live)
    result = detector.detect(live)
    folder = output_folder(args.output)
    for name, picture in _pictures(result, live).items():
        write_png(folder / f'{name}.png', picture)
    write_whole(folder / 'result.json', _json(result, config).encode())
    print(f'{describe(result)} -> {folder}')
    return 0


def _pictures(result: Result, live: np.ndarray) -> dict[str, np.ndarray]:
    return {
        'change_mask': result.change_mask,
        'valid_mask': result.valid_mask,
        'registered': result.registered,
        'rectified': result.rectified,
        'residual': np.clip(np.rint(128 + result.residual), 0, 255).astype(np.uint8),
        'overlay': draw_overlay(live, result),
    }


def _json(result: Result, config: Config) -> str:
    about = {'config': config.nested(), 'version': rsmb_ros.__version__}
    return json.dumps(result_to_dict(result) | about, indent=1, allow_nan=False) + '\n'
