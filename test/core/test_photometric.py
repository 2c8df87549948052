"""Colours in a blur: each in its own light."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from known_frame import known_frame

from rsmb_ros.core.frame import PathFrame
from rsmb_ros.core.photometric import luma, to_display, to_linear
from rsmb_ros.core.reference import Reference
from rsmb_ros.core.synthesis import Nuisances, Scene

GAMMA = 2.2


def red_beside_grey():
    image = np.empty((60, 80, 3), np.uint8)
    image[:] = (150, 150, 150)
    image[:, 40:] = (20, 20, 210)
    return image


def test_an_edge_of_colour_is_no_mixture_of_its_grey_levels():
    """Light adds up per colour, then comes the tone curve; grey levels do not."""
    image = red_beside_grey()
    light = np.stack([to_linear(image[..., n].astype(np.float32), GAMMA) for n in range(3)], axis=2)
    seen = luma(np.rint(to_display(cv2.blur(light, (11, 1)), GAMMA)).astype(np.uint8))
    planes = [to_display(cv2.blur(light[..., n], (11, 1)), GAMMA) for n in range(3)]
    grey = to_display(cv2.blur(to_linear(luma(image), GAMMA), (11, 1)), GAMMA)
    assert np.abs(luma(np.dstack(planes)) - seen).max() < 1.0  # rounding
    assert np.abs(grey - seen).max() > 5.0


@pytest.mark.parametrize(('channels', 'fits'), [(3, True), (1, False)])
def test_the_edge_of_a_coloured_thing_is_predicted_in_colour(executor, channels, fits):
    ground = np.empty((200, 240, 3), np.uint8)
    ground[:] = (150, 150, 150)
    for x in range(0, 240, 40):
        ground[:, x : x + 20] = (20, 20, 210)
    found = known_frame(Scene(ground, 30), executor, nuisances=Nuisances(), blur=9.0, offset=12.0)
    frame = found.frame
    if channels == 1:
        grey = Reference(np.rint(luma(frame._reference.image)).astype(np.uint8), GAMMA)
        frame = PathFrame(grey, frame.live, frame.grey, frame.fit, executor)
    off = np.percentile(np.abs(frame.residual[frame.judged]), 95)
    # quantisation of both images, and the simulator's own interpolation
    assert off < 2.0 if fits else off > 5.0
