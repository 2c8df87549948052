"""
Figures printed by the authors, for the tables of the `authors` suite.

From Rengarajan, Rajagopalan, Aravind, Seetharaman, "Image Registration and Change Detection under
Rolling Shutter Motion Blur", TPAMI 39(10), 2017, doi 10.1109/TPAMI.2016.2630687. Their images are
not public: ours are made by their recipe, so the rows compare kinds of images, not images. Run
times are theirs too: MATLAB, 256 x 384 px, one core at 3.4 GHz.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Range = tuple[float, float]  # lowest and highest printed


@dataclass(frozen=True)
class Published:
    """A row of figures; what the authors do not print is absent."""

    method: str
    values: Mapping[str, float | Range]  # field of `Summary` -> value in its unit


# Each experiment has images of its own: rows stand below the suite of their kind of images.
_TIME = {'seconds': 280.0}  # with three pose parameters; 98 s with two, 1302 s with six
_DEBLURRED = (
    Published('TPAMI: Liang, deblurred', {'f_mean': (0.56, 0.75)}),
    Published('TPAMI: Ringaby, deblurred', {'f_mean': (0.56, 0.82)}),
)
PUBLISHED: Mapping[str, tuple[Published, ...]] = {
    # change detection: precision, PWC [%], F
    'authors/planar RSMB': (
        Published('TPAMI', {'precision': 0.91, 'pwc': 0.67, 'f_mean': 0.95, **_TIME}),
        *_DEBLURRED,
    ),
    'authors/planar RS': (
        Published('TPAMI', {'precision': 0.90, 'pwc': 0.79, 'f_mean': 0.94, **_TIME}),
    ),
    'authors/3D RSMB': (
        Published('TPAMI', {'precision': 0.86, 'pwc': 0.71, 'f_mean': 0.89}),
        *_DEBLURRED,
    ),
    'authors/3D RS': (Published('TPAMI', {'precision': 0.98, 'pwc': 0.48, 'f_mean': 0.94}),),
    # motion of the rows [px]
    'authors/motion 2D nonuniform': (
        Published('TPAMI', {'t_x_rmse': 0.18, 't_y_rmse': 0.14, 'seconds': 98.0}),
        Published('TPAMI: Liang', {'t_x_rmse': 3.45, 't_y_rmse': 0.28}),
        Published('TPAMI: Ringaby', {'t_x_rmse': 1.79, 't_y_rmse': 0.37}),
    ),
    # registration without a change, t_x, t_y, r_z [grey levels]
    'authors/motion 3D uniform': (Published('TPAMI', {'rmse': 1.46, **_TIME}),),
    'authors/motion 3D nonuniform': (Published('TPAMI', {'rmse': 1.17, **_TIME}),),
}
