"""Residuals of what has not changed are as large as the evidence takes them to be."""

from __future__ import annotations

import numpy as np
import pytest

from rsmb_ros.core import Camera, Detector
from rsmb_ros.core.change_finder import ChangeFinder
from rsmb_ros.core.motion import Grid
from rsmb_ros.core.shutter import ShutterTiming
from rsmb_ros.core.synthesis import Nuisances, Scene, aerial_scene, live_frame, reference_image
from rsmb_ros.core.synthesis.paths import Hover

SHAPE = (480, 640)
USUAL = Nuisances(
    gain=1.12, vignetting=0.1, noise_electrons=9000, read_noise=0.3, jpeg_quality=92, bias=2.0
)
DARK = Nuisances(gain=0.6, vignetting=0.2, noise_electrons=3000, read_noise=0.6, jpeg_quality=85)
# Share of pixels beyond 1, 2, 3 sigma: a normal distribution has .317, .046, .0027. 36 unchanged
# frames of the suite `nochange` have .23 to .31, .022 to .062, .0012 to .014: what an edge may be
# off by makes the middle careful, the parallax that no layer explains fills the tails.
LIMITS = {1.0: (0.2, 0.34), 2.0: (0.018, 0.068), 3.0: (0.0003, 0.016)}


def suburb(seed):
    return aerial_scene(SHAPE, np.random.default_rng(seed), margin=40)


@pytest.fixture
def finding_of(monkeypatch):
    """Return the maker of a settled frame of an unchanged scene."""
    findings = []
    find = ChangeFinder.find

    def kept(self, stage, frame, clock):
        findings.append(find(self, stage, frame, clock))
        return findings[-1]

    monkeypatch.setattr(ChangeFinder, 'find', kept)

    def settle(scene, nuisances):
        grid = Grid(SHAPE, SHAPE, 576.0)
        hover = Hover(18.0, 7.0, 40.0, 6e-5, phase=0.4)
        rng = np.random.default_rng(1)
        reference = reference_image(scene, nuisances, rng)
        live, _ = live_frame(
            scene,
            (),
            grid,
            lambda times: hover.poses(1.0, times),
            ShutterTiming(40.0),
            nuisances,
            rng,
        )
        result = Detector(reference, Camera(576.0)).detect(live)
        assert not result.changes
        return findings[-1]

    return settle


@pytest.mark.parametrize('nuisances', [USUAL, DARK], ids=['usual', 'dark'])
@pytest.mark.parametrize('kind', ['flat', 'houses'])
def test_false_positive_rate_of_a_pixel_is_the_nominal_one(finding_of, texture_of, kind, nuisances):
    scene = Scene(texture_of(560, 720, 12), margin=40) if kind == 'flat' else suburb(5)
    finding = finding_of(scene, nuisances)
    squares = finding.seen.squares[finding.frame.judged]
    assert squares.size > 0.8 * SHAPE[0] * SHAPE[1]
    for sigmas, (least, most) in LIMITS.items():
        share = float((squares > sigmas * sigmas).mean())
        assert least < share < most, f'{share:.4f} of the pixels are beyond {sigmas} sigma'
