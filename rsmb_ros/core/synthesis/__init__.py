"""
Camera simulator: live frames with known truth (Eq. 1-5).

A scene is a ground and layers at other depths, with objects that come, go and move. The camera
moves in six degrees of freedom while the rows are read. Light adds up linearly; then comes what a
camera adds, and the tone curve.
"""

from .aerial import SUBURB, Style, aerial_scene
from .depth import reference_depth
from .flight import HOVER, FlightPlan, SyntheticFlight, SyntheticFrame, placed_objects, with_shadows
from .frame import (
    CHANGED,
    OUTSIDE,
    RIM,
    RIM_COVER,
    UNCHANGED,
    Truth,
    live_frame,
    reference_image,
)
from .paths import MOTIONS
from .scene import GONE, NEW, STATIC, Scene, Sheet
from .sensor import USUAL, Nuisances

__all__ = [
    'CHANGED',
    'GONE',
    'HOVER',
    'MOTIONS',
    'NEW',
    'OUTSIDE',
    'RIM',
    'RIM_COVER',
    'STATIC',
    'SUBURB',
    'UNCHANGED',
    'USUAL',
    'FlightPlan',
    'Nuisances',
    'Scene',
    'Sheet',
    'Style',
    'SyntheticFlight',
    'SyntheticFrame',
    'Truth',
    'aerial_scene',
    'live_frame',
    'placed_objects',
    'reference_depth',
    'reference_image',
    'with_shadows',
]
