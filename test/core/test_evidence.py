"""Noise table and evidence: nominal on frames without a change, wider where a place is not sure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from known_frame import CAMERA, known_frame

from rsmb_ros.core.change_finder import LOST, ChangeFinder
from rsmb_ros.core.config import Config
from rsmb_ros.core.evidence import NoiseTable, Texture, evidence
from rsmb_ros.core.frame import PathFrame
from rsmb_ros.core.synthesis import Nuisances, Scene
from rsmb_ros.core.workers import Workers

SHAPE = (240, 320)


@pytest.fixture(scope='module')
def plane(texture_of):
    return Scene(texture_of(SHAPE[0] + 80, SHAPE[1] + 80, 9), 40)


@pytest.fixture(scope='module', params=['usual', 'noisy', 'soft', 'compressed'])
def unchanged(request, plane, executor):
    nuisances = {
        'usual': CAMERA,
        'noisy': Nuisances(gain=0.9, noise_electrons=1500, read_noise=0.6),
        'soft': replace(CAMERA, defocus_px=0.35),
        'compressed': replace(CAMERA, vignetting=0.2, jpeg_quality=75),
    }[request.param]
    return known_frame(plane, executor, nuisances=nuisances)


# Of a Gaussian. Sigma also allows for misplaced edges, so less than the nominal rate is fine;
# the tails of JPEG and interpolation are heavier.
@pytest.mark.parametrize(('beyond', 'least', 'most'), [(1, 0.6, 1.1), (2, 0.4, 1.2), (3, 0.3, 1.6)])
def test_false_alarms_per_pixel_follow_the_nominal_rate(unchanged, beyond, least, most):
    z = unchanged.z[unchanged.frame.judged]
    nominal = math.erfc(beyond / math.sqrt(2.0))
    ratio = float((np.abs(z) > beyond).mean()) / nominal
    assert least < ratio < most


def test_nothing_stands_out_of_an_unchanged_plane(unchanged):
    assert not unchanged.mask.any()


def test_an_uncertain_place_widens_sigma_on_edges_only():
    step = np.full((60, 80), 80.0, np.float32)
    step[:, 40:] = 160.0
    table = NoiseTable.learn(Texture.of(step), np.zeros_like(step), np.ones(step.shape, bool))
    place = np.zeros(60, np.float32)
    place[30:] = 0.3
    sigma = table(Texture.of(step), place)
    np.testing.assert_allclose(sigma[:, :30], table(Texture.of(step))[:, :30], rtol=1e-6)
    np.testing.assert_array_equal(sigma[:30], table(Texture.of(step))[:30])
    # at the edge the gradient is 40 grey levels / px: 0.3 px are 12, two deviations 24
    added = np.sqrt(sigma[40, 39] ** 2 - table(Texture.of(step))[40, 39] ** 2)
    assert abs(added - 2 * 0.3 * 40.0) < 0.1


def test_edges_in_doubtful_rows_raise_less_evidence(plane, executor):
    found = known_frame(plane, executor)
    frame = found.frame
    off = np.roll(frame.predicted, 1, axis=1)
    residual = frame.grey - off
    place = np.zeros(SHAPE[0], np.float32)
    place[120:] = 0.45
    strength = evidence(np.where(frame.judged, residual / found.noise(Texture.of(off), place), 0.0))
    known, doubtful = (
        np.median(strength[rows, 60:260]) for rows in (slice(0, 115), slice(125, 220))
    )
    assert doubtful < 0.6 * known


class _Uncertain(PathFrame):
    """A frame whose last rows have no certain place."""

    lost = slice(180, 240)

    @property
    def row_uncertainty(self):
        place = np.full(SHAPE[0], 0.02)
        place[self.lost] = 1.2 * LOST
        place[10] = np.nan  # a row that says nothing about it
        return place


def test_rows_in_an_unknown_place_are_not_judged(plane, executor):
    frame = known_frame(plane, executor).frame
    uncertain = _Uncertain(frame._reference, frame.live, frame.grey, frame.fit, executor)
    before = uncertain.judged.copy()
    assert before[_Uncertain.lost].any()
    seen = ChangeFinder(Config(), Workers(1))._evidence(uncertain)
    assert not uncertain.judged[_Uncertain.lost].any()
    np.testing.assert_array_equal(uncertain.judged[:180], before[:180])
    assert not seen.strength[_Uncertain.lost][6:].any()
    assert before[10].any()
