"""What is worked out from a reference once."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core import Camera, Config, Detector
from rsmb_ros.core import reference as module
from rsmb_ros.core.reference import Reference, at_limit

SHAPE = (240, 320)
CORNERS = [(30, 40), (30, 60), (180, 250)]  # row, column of bright squares; two of them are near


@pytest.fixture
def bright(texture_of):
    """Return a texture with three clipped squares."""
    image = np.minimum(texture_of(*SHAPE, 31), 200)
    for row, col in CORNERS:
        image[row : row + 8, col : col + 8] = 255
    return image


def test_groups_of_clipped_pixels_have_boxes_of_their_own(bright):
    boxes = Reference(bright, 2.2).clipped_boxes
    assert len(boxes) == 2
    inside = np.zeros(SHAPE, bool)
    for left, top, right, bottom in boxes:
        inside[top:bottom, left:right] = True
    assert inside[at_limit(bright)].all()
    assert inside.mean() < 0.2


def test_groups_are_judged_as_all_together(bright, monkeypatch):
    live = np.roll(bright, (3, -5), axis=(0, 1))
    config = Config().replaced({'layers.enabled': False})

    def detected():
        return Detector(bright, Camera(300.0), config).detect(live)

    apart = detected()
    monkeypatch.setattr(module, 'NEAR', max(SHAPE))
    assert len(Reference(bright, 2.2).clipped_boxes) == 1
    together = detected()
    np.testing.assert_array_equal(apart.valid_mask, together.valid_mask)
    np.testing.assert_array_equal(apart.residual, together.residual)
