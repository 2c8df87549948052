"""What is timed is what it is called."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core import REGISTERED, Config, Detector
from rsmb_ros.evaluation.speed import flights, timing
from rsmb_ros.evaluation.speed.flights import (
    flight_plan,
    flights_at,
    frames_at,
    timed_flight,
)
from rsmb_ros.evaluation.speed.timing import (
    COLD,
    FLAT,
    GIVEN,
    HOLD,
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


def test_every_frame_of_a_flight_is_timed_with_every_method():
    flight = timed_flight('layered', 1, SMALL, 2)
    found = list(times_of_flight(flight, Config()))
    assert len(found) == 2
    for timed in found:
        assert (timed.shape, timed.scene) == (SMALL, 'layered')
        assert set(timed.ours) == set(variants(Config(), 1.0))
        assert timed.ecc_registered
        assert timed.ecc_ms > 0
        assert timed.floor.render.flops > 0
        assert all(one.registered for one in timed.ours.values())
        for one in timed.ours.values():
            assert 0 < one.registration_ms < one.total_ms + 20.0


def test_stream_is_shown_its_frames_before_and_goes_on_in_their_order(monkeypatch):
    shown = {name: [] for name in variants(Config(), 1.0)}

    class Shown:
        registered = None

        def __init__(self, reference, camera, config):
            names = {config: name for name, config in variants(Config(), 50.0).items()}
            self.frames = shown[names[config]]

        def detect(self, live):
            self.frames.append(int(live[0, 0, 0]))
            return self

    flight = timed_flight('planar', 0, SMALL, 1)
    live = tuple(np.full_like(flight.live[0], n) for n in range(3))
    monkeypatch.setattr(timing, 'Detector', Shown)
    monkeypatch.setattr(timing, '_timed', lambda flight, grey, live, detectors, *rest: live)
    timed = list(times_of_flight(replace(flight, live=live), Config()))
    assert shown[WARM] == [n % 3 for n in range(timing.TAUGHT)]
    assert [int(one[0, 0, 0]) for one in timed] == [(timing.TAUGHT + n) % 3 for n in range(3)]
    assert shown[COLD] == [0, 0]


def test_large_frames_are_timed_with_what_the_table_of_sizes_needs(monkeypatch):
    monkeypatch.setattr(flights, 'MOST_PIXELS', SMALL[0] * SMALL[1] - 1)
    (timed,) = times_of_flight(timed_flight('planar', 1, SMALL, 1), Config())
    assert set(timed.ours) == {COLD, FLAT}


# -- flights -------------------------------------------------------------------------------------


def test_large_sizes_get_fewer_flights_and_frames():
    sizes = ((240, 320), (480, 640), (720, 1280), (1080, 1920))
    assert [flights_at(shape, 4) for shape in sizes] == [4, 4, 2, 1]
    assert [frames_at(shape, 3) for shape in sizes] == [3, 3, 3, 2]
    assert [flights_at(shape, 1) for shape in sizes] == [1, 1, 1, 1]
    assert [frames_at(shape, 1) for shape in sizes] == [1, 1, 1, 1]


def test_sizes_show_the_same_draws():
    small, large = (flight_plan('planar', 2, shape, 1) for shape in (SMALL, (480, 640)))
    assert small.nuisances == large.nuisances
    assert small.timing == large.timing
    assert 2 * small.blur_px == large.blur_px
    assert 2 * small.offset_px == large.offset_px


def test_equal_flights_are_equal_and_their_frames_are_not():
    one, same = (timed_flight('layered', 0, SMALL, 2) for _ in range(2))
    np.testing.assert_array_equal(one.reference, same.reference)
    np.testing.assert_array_equal(one.live, same.live)
    assert (one.live[0] != one.live[1]).mean() > 0.5
    assert one.shape == one.reference.shape[:2] == SMALL


def test_only_the_layered_scene_has_houses():
    """They move with the parallax; on flat ground the path explains everything but the objects."""
    shares = {}
    for scene in ('planar', 'layered'):
        flight = timed_flight(scene, 1, (480, 640), 1)
        result = Detector(flight.reference, flight.camera, Config()).detect(flight.live[0])
        shares[scene] = sum(region.kind == 'static' for region in result.regions)
    assert shares['planar'] == 0 < shares['layered']


def test_objects_are_there_from_the_first_frame_on():
    flight = timed_flight('planar', 0, (480, 640), 1)
    result = Detector(flight.reference, flight.camera, Config()).detect(flight.live[0])
    assert sum(region.kind == 'change' for region in result.regions) >= 2
