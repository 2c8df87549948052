"""Tables of what was timed frame by frame: ratio to ECC, cost a pixel, floor, steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean

from rsmb_ros.report.html import Table

from ..metrics import NAN, ratio
from ..summary import median
from ..tables import ABSENT
from .machine import Rates
from .probes import Memory
from .spread import Spread, number, size_name
from .timing import COLD, FLAT, GIVEN, WARM, FrameTimes, Times

Kind = tuple[tuple[int, int], str]  # shape and scene
_MEGA = 1e6


def registration_table(frames: Sequence[FrameTimes], rates: Rates) -> Table:
    """Registration and rendering beside ECC and the floor."""
    rows = []
    for (shape, scene), group in by_kind(frames).items():
        floor_ms = 1e3 * median(one.floor.seconds(rates) for one in group if one.floor)
        for variant in (COLD, GIVEN, WARM):
            ours = times_of(group, variant)
            if ours:
                spread = Spread.of(one.registration_ms for one in ours)
                rows.append(
                    [
                        f'{size_name(shape)} {scene}, {variant}',
                        *_lost(group, ours),
                        *spread.cells('.1f'),
                        *Spread.of(one.ecc_ms for one in group).cells('.1f'),
                        *registration_ratio(group, variant).cells('.3f'),
                        number(ns_per_pixel(spread.median, shape), '.0f'),
                        number(floor_ms, '.2f'),
                        number(ratio(spread.median, floor_ms), '.1f'),
                    ]
                )
    head = ['frames', 'timed', 'lost, ECC lost', 'ms', 'quartiles', 'ECC ms', 'quartiles']
    head += ['x ECC', 'quartiles', 'ns / px', 'floor ms', 'x floor']
    return Table('Registration and rendering', head, rows)


def total_table(frames: Sequence[FrameTimes]) -> Table:
    """Everything from the frame to its changes beside ECC's registration alone."""
    rows = []
    for (shape, scene), group in by_kind(frames).items():
        for variant in (COLD, FLAT, GIVEN, WARM):
            ours = times_of(group, variant)
            if ours:
                spread = Spread.of(one.total_ms for one in ours)
                rows.append(
                    [
                        f'{size_name(shape)} {scene}, {variant}',
                        *spread.cells('.0f'),
                        *total_ratio(group, variant).cells('.2f'),
                        number(ns_per_pixel(spread.median, shape), '.0f'),
                    ]
                )
    head = ['frames', 'ms', 'quartiles', 'x ECC', 'quartiles', 'ns / px']
    return Table('End to end: changes, static objects and all', head, rows)


def floor_table(frames: Sequence[FrameTimes], memory: Sequence[Memory], rates: Rates) -> Table:
    """What the floor is counted from, and what a size takes besides time."""
    peaks = {one.shape: one for one in memory}
    rows = []
    for shape in dict.fromkeys([*(one.shape for one in frames), *peaks]):
        group = [one for one in frames if one.shape == shape]
        floors = [one.floor for one in group if one.floor]
        works = [one.fit + one.render for one in floors]
        peak = peaks.get(shape, Memory(shape, NAN, NAN))
        rows.append(
            [
                size_name(shape),
                number(_mean(one.points for one in floors), '.0f'),
                number(_mean(one.samples for one in floors), '.1f'),
                number(_mean(one.unknowns for one in floors), '.0f'),
                number(_mean(one.fit.flops for one in floors) / _MEGA, '.0f'),
                number(_mean(one.render.flops for one in floors) / _MEGA, '.0f'),
                number(_mean(one.bytes for one in works) / _MEGA, '.0f'),
                number(1e3 * _mean(one.seconds(rates) for one in floors), '.2f'),
                *Spread.of(one.prepare_ms for one in group).cells('.0f'),
                number(peak.peak / _MEGA, '.0f'),
                number(peak.idle / _MEGA, '.0f'),
            ]
        )
    head = ['size', 'points', 'instants a row', 'unknowns a row', 'MFLOP fit', 'MFLOP render']
    head += ['MB touched', 'floor ms', 'reference prepared ms', 'quartiles']
    head += ['peak MB above idle', 'idle MB']
    return Table('Floor and memory', head, rows)


def step_tables(frames: Sequence[FrameTimes]) -> list[Table]:
    """Where the time of a frame goes, a table a size; 0 where a step is not taken."""
    shapes = dict.fromkeys(one.shape for one in frames)
    return [_step_table([one for one in frames if one.shape == shape]) for shape in shapes]


def _step_table(frames: Sequence[FrameTimes]) -> Table:
    """Steps of all frames of one size, medians and quartiles."""
    found = {
        (scene, variant): times
        for (_, scene), group in by_kind(frames).items()
        for variant in (COLD, WARM)
        if (times := times_of(group, variant))
    }
    steps = dict.fromkeys(
        step for times in found.values() for one in times for step in one.steps_ms
    )
    rows = [
        [step, *_cells([one.steps_ms.get(step, 0.0) for one in times] for times in found.values())]
        for step in steps
    ]
    rows.append(['elsewhere', *_cells([o.elsewhere_ms for o in one] for one in found.values())])
    rows.append(['end to end', *_cells([o.total_ms for o in one] for one in found.values())])
    colour = [ABSENT, ABSENT] * len(found)
    for n, (scene, variant) in enumerate(found):
        if variant == COLD:
            spent = Spread.of(one.colour_ms for one in frames if one.scene == scene)
            colour[2 * n : 2 * n + 2] = spent.cells('.1f')
    rows.append(['registered in colour', *colour])
    head = [text for kind in found for text in (', '.join(kind), 'quartiles')]
    return Table(f'Where the time goes at {size_name(frames[0].shape)}', ['ms', *head], rows)


def _cells(groups: Iterable[Iterable[float]]) -> list[str]:
    return [cell for group in groups for cell in Spread.of(group).cells('.1f')]


def by_kind(frames: Iterable[FrameTimes]) -> Mapping[Kind, list[FrameTimes]]:
    """Return the frames of each size and scene, in their order."""
    groups: dict[Kind, list[FrameTimes]] = {}
    for frame in frames:
        groups.setdefault((frame.shape, frame.scene), []).append(frame)
    return groups


def times_of(frames: Iterable[FrameTimes], variant: str) -> list[Times]:
    """Return the times of a variant, where it was measured."""
    return [frame.ours[variant] for frame in frames if variant in frame.ours]


def registration_ratio(frames: Iterable[FrameTimes], variant: str) -> Spread:
    """Return how many times ECC's time a variant takes, frame by frame."""
    return Spread.of(
        ratio(frame.ours[variant].registration_ms, frame.ecc_ms)
        for frame in frames
        if variant in frame.ours
    )


def total_ratio(frames: Iterable[FrameTimes], variant: str) -> Spread:
    """Return how many times ECC's time a variant takes with changes and all, frame by frame."""
    return Spread.of(
        ratio(frame.ours[variant].total_ms, frame.ecc_ms)
        for frame in frames
        if variant in frame.ours
    )


def ns_per_pixel(ms: float, shape: tuple[int, int]) -> float:
    """Return the cost of a pixel of the live frame [ns]."""
    return 1e6 * ms / (shape[0] * shape[1])


def _lost(group: Sequence[FrameTimes], ours: Sequence[Times]) -> tuple[str, str]:
    lost = sum(not one.registered for one in ours)
    ecc_lost = sum(not one.ecc_registered for one in group)
    return str(len(ours)), f'{lost}, {ecc_lost}'


def _mean(values: Iterable[float]) -> float:
    known = list(values)
    return fmean(known) if known else NAN
