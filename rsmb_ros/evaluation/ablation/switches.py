"""
Parts of the method that can be switched off, one at a time.

Where a parameter does it, that is used. The others have none, for nobody should run without them:
they are replaced in this process for the time of a block, which is for measuring only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from rsmb_ros.core import change_finder, colour, depth_rims, depth_search, evidence
from rsmb_ros.core.evidence import MIN_SIGMA, NoiseTable, Texture
from rsmb_ros.core.frame import RegisteredFrame
from rsmb_ros.core.layers import Layer

NEVER = 1e9  # a threshold that nothing reaches


@dataclass(frozen=True)
class Swap:
    """A name of a module or a class, and what stands there instead."""

    owner: Any
    name: str
    value: Any


@dataclass(frozen=True)
class Switch:
    """One part, and how it is switched off."""

    name: str
    instead: str  # what happens without it
    group: str
    settings: Mapping[str, object] = field(default_factory=dict)
    swaps: tuple[Swap, ...] = ()

    @contextmanager
    def off(self) -> Iterator[None]:
        """Swap what has no parameter while the block runs; in this process, for all threads."""
        with ExitStack() as stack:
            for swap in self.swaps:
                stack.enter_context(patch.object(swap.owner, swap.name, swap.value))
            yield


def _one_sigma(texture: Texture, residual: np.ndarray, valid: np.ndarray) -> NoiseTable:
    """Learn one noise for all intensities and textures."""
    table = _learn(texture, residual, valid)
    known = np.abs(residual[valid])
    sigma = max(1.4826 * float(np.median(known)), MIN_SIGMA) if known.size else MIN_SIGMA
    return replace(table, sigma=np.full_like(table.sigma, sigma))


def _nothing_clipped(frame: RegisteredFrame) -> np.ndarray:
    return np.zeros(frame.grey.shape, bool)


def _no_misfit(frame: RegisteredFrame, layers: list[Layer]) -> None:
    """Put layers in front as if they fitted as well as the ground."""
    _put_in_front(frame, layers)
    frame.misfit[:] = 1.0


def _only_masked(frame: RegisteredFrame, layers: list[Layer]) -> None:
    """Leave out what layers may cover: explained, but not rendered."""
    frame.judged &= ~frame.foreground(layers)


_learn: Callable[..., NoiseTable] = NoiseTable.learn
_put_in_front = RegisteredFrame.put_in_front

EVIDENCE, OBJECTS, MOTION = 'evidence', 'objects and layers', 'registration and light'
SWITCHES = (
    Switch(
        'noise by intensity and texture',
        'one noise for the whole frame',
        EVIDENCE,
        swaps=(Swap(NoiseTable, 'learn', _one_sigma),),
    ),
    Switch(
        'edges off by a little',
        'edges must lie exactly',
        EVIDENCE,
        swaps=(Swap(evidence, 'MISPLACED', 0.0),),
    ),
    Switch(
        "a row's own uncertainty",
        'all rows count as sure',
        EVIDENCE,
        swaps=(Swap(evidence, 'PLACE_SHARE', np.float32(0.0)),),
    ),
    Switch(
        'saturation',
        'what is clipped is judged',
        EVIDENCE,
        swaps=(Swap(RegisteredFrame, '_clipped', _nothing_clipped),),
    ),
    Switch(
        'misfit of a layer',
        'layers must fit as well as the ground',
        EVIDENCE,
        swaps=(Swap(RegisteredFrame, 'put_in_front', _no_misfit),),
    ),
    Switch(
        'colour',
        'only brightness counts',
        EVIDENCE,
        swaps=(Swap(colour, 'WEIGHT', np.float32(1e-6)),),
    ),
    Switch(
        'hysteresis',
        'regions do not grow below 4.99 sigma',
        OBJECTS,
        {'change.threshold_low': 4.99},
    ),
    Switch('layers', 'the scene counts as flat', OBJECTS, {'layers.enabled': False}),
    Switch(
        'compositing of layers',
        'they are left out, not rendered',
        OBJECTS,
        swaps=(Swap(RegisteredFrame, 'put_in_front', _only_masked),),
    ),
    Switch(
        "an object's other place",
        'a static object may stand out once',
        OBJECTS,
        swaps=(Swap(depth_search, 'MIN_DISPLACED', -1.0),),
    ),
    Switch(
        'rims of layers',
        'thin pieces beside them are changes',
        OBJECTS,
        swaps=(Swap(depth_rims, 'WIDTH', 0.0),),
    ),
    Switch(
        'last look',
        'no search once the layers are in front',
        OBJECTS,
        swaps=(Swap(change_finder, 'LAST_LOOKS', 0),),
    ),
    Switch(
        'the other way round',
        'what fits first is the ground',
        OBJECTS,
        swaps=(Swap(change_finder, 'DOUBT', NEVER),),
    ),
    Switch('linear light', 'display values add up', MOTION, {'camera.gamma': 1.0}),
    Switch('vignetting', 'one gain', MOTION, {'photometric.vignetting': False}),
    Switch('tilt', '4 degrees of freedom', MOTION, {'registration.degrees_of_freedom': 4}),
    Switch('row refinement', 'the path stands', MOTION, {'registration.refine_rows': False}),
)
