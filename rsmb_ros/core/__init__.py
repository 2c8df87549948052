"""The method, without ROS and without files."""

from .camera import Camera
from .config import Config
from .detector import Detector, warm_up
from .errors import BagError, ConfigError, FileProblem, FrameError, RsmbError
from .types import MOTION_COLUMNS, MOTION_UNITS, NOT_REGISTERED, REGISTERED, Region, Result

__all__ = [
    'MOTION_COLUMNS',
    'MOTION_UNITS',
    'NOT_REGISTERED',
    'REGISTERED',
    'BagError',
    'Camera',
    'Config',
    'ConfigError',
    'Detector',
    'FileProblem',
    'FrameError',
    'Region',
    'Result',
    'RsmbError',
    'warm_up',
]
