"""Pixels of a nadir camera on the earth, against geodesy by other formulas."""

import math

import numpy as np
import pytest

from rsmb_ros.replay.ground import View, metres_per_degree

A, B = 6378137.0, 6356752.314245179  # m, half axes of WGS84
SHAPE, FOCAL_PX = (481, 641), 500.0


def pixels(*offsets):
    """Return pixels at offsets x, y from the middle of the image."""
    return np.array([320.0, 240.0]) + np.array(offsets)


def earth_fixed(latitude, longitude, altitude=0.0):
    """Return x, y, z [m] in the frame of the earth: the textbook's formula."""
    phi, lam = math.radians(latitude), math.radians(longitude)
    e2 = 1 - (B / A) ** 2
    n = A / math.sqrt(1 - e2 * math.sin(phi) ** 2)
    ring = (n + altitude) * math.cos(phi)
    return np.array([ring * math.cos(lam), ring * math.sin(lam),
                     (n * (1 - e2) + altitude) * math.sin(phi)])  # fmt: skip


def east_north(latitude, longitude, place):
    """Return how far east and north [m] a place on the ground (lon, lat) lies."""
    phi, lam = math.radians(latitude), math.radians(longitude)
    way = earth_fixed(place[1], place[0]) - earth_fixed(latitude, longitude)
    east = np.array([-math.sin(lam), math.cos(lam), 0.0])
    north = np.array([-math.sin(phi) * math.cos(lam), -math.sin(phi) * math.sin(lam),
                      math.cos(phi)])  # fmt: skip
    return np.array([way @ east, way @ north])


def view(latitude=47.0, longitude=8.5, height=100.0, heading=0.0, ground_altitude=0.0):
    return View(latitude, longitude, height, heading, ground_altitude)


def test_centre_lies_under_the_camera():
    assert view().positions(pixels((0, 0)), SHAPE, FOCAL_PX) == [(8.5, 47.0)]


@pytest.mark.parametrize('latitude', [-80.0, -33.9, 0.0, 47.0, 69.0])
@pytest.mark.parametrize(
    ('heading', 'wanted'),
    [(0.0, (20.0, 10.0)), (90.0, (10.0, -20.0)), (180.0, (-20.0, -10.0)), (-90.0, (-10.0, 20.0))],
)
def test_offset_in_the_image_is_one_on_the_ground(latitude, heading, wanted):
    # 100 px right and 50 px up, 0.2 m each
    (place,) = view(latitude, heading=heading).positions(pixels((100, -50)), SHAPE, FOCAL_PX)
    # 22 m off, a plane differs from the ellipsoid by less than 1 mm
    np.testing.assert_allclose(east_north(latitude, 8.5, place), wanted, atol=1e-3)


def test_area_of_a_box_is_its_pixels_times_their_size():
    corners = pixels((-30, 20), (30, 20), (30, -20), (-30, -20))
    ring = view(heading=37.0).positions(corners, SHAPE, FOCAL_PX)
    x, y = np.array([east_north(47.0, 8.5, place) for place in ring]).T
    area = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert area == pytest.approx(60 * 40 * 0.2**2, rel=1e-4)  # positive: counter-clockwise


def test_higher_ground_is_larger_in_metres():
    low, high = metres_per_degree(47.0), metres_per_degree(47.0, 3000.0)
    for at_sea, above in zip(low, high, strict=True):
        assert above / at_sea == pytest.approx(1 + 3000 / 6.37e6, abs=3e-6)


def test_degrees_are_as_long_as_tables_say():
    # NIMA TR8350.2: at 45 degrees a degree of latitude has 111131.8 m, of longitude 78846.8 m
    along, across = metres_per_degree(45.0)
    assert (along, across) == (pytest.approx(111131.8, abs=1), pytest.approx(78846.8, abs=1))


def test_box_across_the_date_line_is_not_torn():
    corners = pixels((-100, 0), (100, 0))
    (west, _), (east, _) = view(0.0, 180.0).positions(corners, SHAPE, FOCAL_PX)
    assert 0 < east - west < 1e-3
