"""What is timed is what it is called."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core import REGISTERED, Config
from rsmb_ros.evaluation.speed.flights import timed_flight
from rsmb_ros.evaluation.speed.timing import (
    COLD,
    FLAT,
    GIVEN,
    HOLD,
    TAUGHT,
    WARM,
    time_ecc,
    time_ours,
    times_of_flight,
    variants,
)

SMALL = (240, 320)


def test_variants_differ_in_what_they_are_called_after():
    config = Config().replaced({'shutter.exposure_rows': 7.0, 'registration.knot_rows': 30.0})
    found = {name: one.flat() for name, one in variants(config, 42.0).items()}
    exposures = {name: one['shutter.exposure_rows'] for name, one in found.items()}
    assert exposures.pop(GIVEN) == 42.0
    assert set(exposures.values()) == {0.0}
    assert [name for name, one in found.items() if not one['layers.enabled']] == [FLAT]
    assert all(one['registration.knot_rows'] == 30.0 for one in found.values())
    assert {COLD, GIVEN, FLAT} <= set(found)


def test_only_the_warm_variant_remembers():
    known = HOLD in Config().flat()
    found = variants(Config(), 42.0)
    assert (WARM in found) == known
    if known:
        assert [name for name, one in found.items() if one.flat()[HOLD]] == [WARM]


def test_registration_is_every_step_but_those_of_the_changes():
    steps = {'coarse': 1.0, 'something new': 2.0, 'layers': 4.0, 'other way': 8.0, 'refine': 16.0}
    result = SimpleNamespace(status=REGISTERED, timings_ms=steps, exposure_rows=5.0)
    detector = SimpleNamespace(detect=lambda live: result)
    times, same = time_ours(detector, np.zeros((32, 32), np.uint8))
    assert same is result
    assert times.registered
    assert 3.0 <= times.registration_ms < 3.0 + 20.0  # and the grey levels of 32x32 px
    assert times.elsewhere_ms == pytest.approx(times.total_ms - 31.0)


def test_ecc_that_gives_up_is_timed_and_told():
    rng = np.random.default_rng(20170301)
    one, other = rng.integers(0, 255, (2, 64, 64), dtype=np.uint8)
    ms, registered = time_ecc(one.astype(np.float32), other)
    assert ms > 0
    assert not registered


def test_flight_is_timed_after_the_frames_that_teach():
    first, second, third, timed = times_of_flight('layered', 1, SMALL, 1, Config())
    assert TAUGHT == 3
    assert first is second is third is None
    assert (timed.shape, timed.scene) == (SMALL, 'layered')
    assert set(timed.ours) == set(variants(Config(), 1.0))
    assert timed.ecc_registered
    assert all(one.registered for one in timed.ours.values())
    for one in timed.ours.values():
        assert 0 < one.registration_ms < one.total_ms + 20.0
    assert timed.ecc_ms > 0
    assert timed.floor.render.flops > 0


def test_sizes_show_the_same_draws():
    small, large = (timed_flight('planar', 2, shape, 1).plan for shape in (SMALL, (480, 640)))
    assert small.nuisances == large.nuisances
    assert small.timing == large.timing
    assert 2 * small.blur_px == large.blur_px
    assert 2 * small.offset_px == large.offset_px


def test_scenes_are_flat_and_layered():
    depths = {}
    for scene in ('planar', 'layered'):
        (frame,) = timed_flight(scene, 0, SMALL, 1).frames()
        depths[scene] = frame.truth.depths
    assert depths['planar'] == ()
    assert 0 < min(depths['layered']) < 1
