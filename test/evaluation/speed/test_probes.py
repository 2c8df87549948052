"""Measurements in other processes."""

import sys

import pytest

from rsmb_ros.core import Config
from rsmb_ros.evaluation.speed import child, probes
from rsmb_ros.evaluation.speed.flights import timed_flight


@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='read from /proc')
def test_memory_holds_at_least_the_half_pixel_reference():
    found = probes.peak_memory(timed_flight('layered', 0, (240, 320), 1), Config())
    assert 4e7 < found.idle < 2e9  # numpy, OpenCV, numba
    assert 16 * 240 * 320 < found.peak < 1e9


def test_start_is_measured_with_an_empty_and_with_a_filled_cache(monkeypatch):
    asked = []

    def run(config, job, **environment):
        asked.append((config, job, environment['NUMBA_CACHE_DIR']))
        return {'imports': 1.0, 'warm_up': 10.0 / len(asked)}

    monkeypatch.setattr(probes, '_child', run)
    cold, *warm = probes.start_ups(Config())
    assert not cold.cached
    assert len(warm) == probes.STARTS - 1
    assert all(one.cached for one in warm)
    assert (cold.warm_up, warm[0].warm_up) == (10.0, 5.0)
    assert all(one == asked[0] for one in asked)  # the same cache


def test_start_times_imports_and_kernels():
    found = child.start({})
    assert set(found) == {'imports', 'warm_up'}
    assert all(0 <= seconds < 600 for seconds in found.values())
    assert found['warm_up'] > 0
