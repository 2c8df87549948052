"""A part that is switched off is off in the block, and only there."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rsmb_ros.core import Config, Detector, evidence
from rsmb_ros.core.evidence import MIN_SIGMA, NoiseTable, Texture
from rsmb_ros.core.frame import RegisteredFrame
from rsmb_ros.core.render import Shown
from rsmb_ros.evaluation.ablation.switches import SWITCHES
from rsmb_ros.evaluation.speed.flights import timed_flight

SWITCH = {one.name: one for one in SWITCHES}


@pytest.fixture(scope='module')
def flight():
    """Return a layered flight of one frame, so bright that some of it is clipped."""
    dark = timed_flight('layered', 1, (480, 640), 1)
    bright = [cv2.convertScaleAbs(image, alpha=1.4) for image in (dark.reference, *dark.live)]
    return replace(dark, reference=bright[0], live=tuple(bright[1:]))


def detected(flight, **settings):
    """Detect the changes of its frame."""
    config = Config().replaced(settings)
    return Detector(flight.reference, flight.camera, config).detect(flight.live[0])


def said(result):
    """Return everything of a result that a switch may change."""
    return result.change_mask.tobytes(), result.valid_mask.tobytes(), result.row_motion.tobytes()


def test_names_are_known_by_and_say_what_happens_instead():
    assert len(SWITCH) == len(SWITCHES)
    for one in SWITCHES:
        assert one.instead
        assert one.settings or one.swaps
        Config().replaced(one.settings)


@pytest.mark.parametrize('switch', [one for one in SWITCHES if one.swaps], ids=lambda one: one.name)
def test_every_swap_replaces_what_is_there_and_puts_it_back(switch):
    before = [swap.owner.__dict__[swap.name] for swap in switch.swaps]
    with switch.off():
        assert [swap.owner.__dict__[swap.name] for swap in switch.swaps] == [
            swap.value for swap in switch.swaps
        ]
    assert [swap.owner.__dict__[swap.name] for swap in switch.swaps] == before


def test_an_error_puts_it_back_too():
    before = evidence.MISPLACED
    with pytest.raises(ZeroDivisionError), SWITCH['edges off by a little'].off():
        assert evidence.MISPLACED == 0.0
        raise ZeroDivisionError
    assert evidence.MISPLACED == before > 0


REACHED = (
    'noise by intensity and texture',
    'edges off by a little',
    "a row's own uncertainty",
    'saturation',
    'compositing of layers',
)


@pytest.mark.parametrize('name', REACHED)
def test_the_detector_feels_it(flight, name):
    """A part that the core has renamed or copied would be on all the time."""
    full = detected(flight)
    with SWITCH[name].off():
        off = detected(flight)
    assert said(off) != said(full)
    assert said(detected(flight)) == said(full)


def test_layers_that_are_not_composited_are_not_judged(flight):
    """What lies inside them is known with compositing only."""
    full = detected(flight)
    with SWITCH['compositing of layers'].off():
        off = detected(flight)
    assert any(region.kind == 'static' for region in off.regions)
    assert (off.valid_mask > 0).mean() < (full.valid_mask > 0).mean() - 0.005


def test_one_noise_is_the_same_everywhere():
    rng = np.random.default_rng(20170301)
    image = rng.uniform(0, 255, (60, 80)).astype(np.float32)
    residual = rng.normal(0, 4.0, image.shape).astype(np.float32)
    residual[:, 40:] *= 3.0
    with SWITCH['noise by intensity and texture'].off():
        table = NoiseTable.learn(Texture.of(image), residual, np.ones(image.shape, bool))
        empty = NoiseTable.learn(Texture.of(image), residual, np.zeros(image.shape, bool))
    assert np.ptp(table.sigma) == 0
    assert 4.0 < table.sigma[0, 0] < 12.0
    assert np.ptp(empty.sigma) == 0
    assert empty.sigma[0, 0] == MIN_SIGMA


def test_misfit_of_a_layer_is_forgotten():
    frame = object.__new__(Misfitting)
    frame.misfit = np.full((4, 5), 2.0, np.float32)
    with SWITCH['misfit of a layer'].off():
        RegisteredFrame.put_in_front(frame, [])
    assert (frame.misfit == 1.0).all()


class Misfitting(RegisteredFrame):
    """A frame without layers."""

    path = row_motion = row_uncertainty = exposure_rows = gain = render = registered = None
    _executor, _in_front = None, {}
    predicted, grey = np.zeros((2, 4, 5), np.float32)
    _ground = Shown(predicted, None, grey > 0)
    _colours = None

    class _hidden:  # noqa: N801 - as it is called there
        of = staticmethod(lambda layers: [])
