"""
Where on the earth a pixel of a camera lies that looks straight down on flat ground.

    east, north = R(heading) (h / f) (x - c_x, c_y - y)
    latitude    = latitude_0  + north / (M + a)
    longitude   = longitude_0 + east / ((N + a) cos latitude_0)

h: height above ground [m], f: focal length [px], c: image centre, a: altitude of the ground [m],
M, N: radii of curvature of WGS84 along the meridian and across it [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_SEMI_MAJOR = 6378137.0  # m, WGS84
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = _FLATTENING * (2.0 - _FLATTENING)


@dataclass(frozen=True)
class View:
    """What a nadir camera sees at one moment."""

    latitude: float  # of the camera [deg]
    longitude: float  # [deg]
    height: float  # above the ground [m]
    heading: float  # of the image's upper edge, clockwise from true north [deg]
    ground_altitude: float  # above the ellipsoid; a change by 100 m is one of 0.002 % [m]

    def positions(
        self, pixels: np.ndarray, shape: tuple[int, ...], focal_px: float
    ) -> list[tuple[float, float]]:
        """
        Return longitude and latitude [deg] of pixels.

        Parameters
        ----------
        pixels : ndarray of shape (n, 2)
            x, y [px]; a pixel's own place is its centre.
        shape : tuple of int
            Rows and columns of the image, whose centre looks straight down [px].
        focal_px : float
            [px]

        """
        metres = self.height / focal_px
        right = metres * (pixels[:, 0] - (shape[1] - 1) / 2)
        up = metres * ((shape[0] - 1) / 2 - pixels[:, 1])
        turn = math.radians(self.heading)
        east = right * math.cos(turn) + up * math.sin(turn)
        north = up * math.cos(turn) - right * math.sin(turn)
        along, across = metres_per_degree(self.latitude, self.ground_altitude)
        # only the camera's is brought to -180..180: a box across the date line must not be torn
        longitudes = (self.longitude + 180.0) % 360.0 - 180.0 + east / across
        latitudes = self.latitude + north / along
        return [(float(x), float(y)) for x, y in zip(longitudes, latitudes, strict=True)]


def metres_per_degree(latitude: float, altitude: float = 0.0) -> tuple[float, float]:
    """Return the lengths of a degree of latitude and of one of longitude [m] at a place."""
    phi = math.radians(latitude)
    w_2 = 1.0 - _ECCENTRICITY_2 * math.sin(phi) ** 2
    across = _SEMI_MAJOR / math.sqrt(w_2)
    along = across * (1.0 - _ECCENTRICITY_2) / w_2
    degree = math.pi / 180.0
    return degree * (along + altitude), degree * (across + altitude) * math.cos(phi)
