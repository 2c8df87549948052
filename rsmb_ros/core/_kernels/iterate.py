"""Robust Gauss-Newton of a camera path: all iterations at one size, by as many threads as come."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .fit import correct, linearise
from .fit_row import AHEAD, BIAS_SCALE, BLURRED, EXPOSED
from .geometry import INLINED, MOST_INSTANTS, OPTIONS, RUN_STEP, corner_runs
from .normal import assemble, assemble_gradient, next_step
from .residuals import spread
from .team import close, hand_in, set_out, taken, wait_for_all, wait_for_any

NO_RESIDUAL = 1e8  # residuals above this mark points without reference
OUTLIER = 30.0  # grey levels; residuals beyond count as that when fits are compared
BINS_PER_LEVEL = 16.0  # of the histogram that residuals' median is read from
ROW_SEEN = 0.2  # share of a row's points that must lie in the reference for it to be waited for
MIN_SIGMA = 1.0  # grey levels; no camera is quieter
RELAXED_AFTER = 3  # iterations, after which the last stiffness holds
# A step after which the residuals are so much larger [grey levels] was too long: along what hardly
# changes the image, a step is as long as its outcome is uncertain.
WORSE, LITTLE_WORSE = 1.1, 0.05
SHORTER = 0.25  # share of such a step that is tried instead
NEVER = 1 << 30  # iterations
LEAP = 0.2  # of the exposure that one step may change
LEAST_CHANGE, MOST_CHANGE = 0.4, 1.6  # of the exposure while one image size is fitted
DEFOCUS = (-0.3, 1.5)  # px^2, range; below 0 where the live frame is the sharper one
# Mean square of what 1 px of each path coordinate moves the pixels of a 4:3 frame [px^2].
REACH = np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.2])
RENEWED, TUKEY, SIGMA, MISPLACED, ORDER = range(5)  # numbers of an order, and how many


class Scene(NamedTuple):
    """What a path is fitted to at one size, see `fit.linearise`: nothing of it changes."""

    bounds: np.ndarray
    fine: np.ndarray
    softer: np.ndarray
    half_rows: int
    half_columns: int
    rows: np.ndarray
    times: np.ndarray
    row_times: np.ndarray  # (R,) times of the rows of the frame that those of points lie in
    frame_rows: int
    places: np.ndarray
    values: np.ndarray
    inverse_depth: np.ndarray | None
    first_time: float
    knot_rows: float
    defocus: float  # of `fine` [px^2]
    focal: float
    center: np.ndarray
    level: float
    dof: int
    tones: np.ndarray
    gamma: float


class Room(NamedTuple):
    """What a fit is worked out in, see `fit.linearise`, and what is left there at its end."""

    begins: np.ndarray
    normals: np.ndarray
    gradients: np.ndarray
    residuals: np.ndarray
    jacobians: np.ndarray
    knots_of: np.ndarray
    edges: np.ndarray
    soft: np.ndarray
    samples: np.ndarray  # (R,) instants
    runs: np.ndarray  # (R,) px
    along: np.ndarray  # for `corner_runs`
    bins: np.ndarray
    seen: np.ndarray  # (R,) bool
    order: np.ndarray  # (ORDER,) what is to be done
    bands: np.ndarray  # (3, D * W) of the equations, believed, and their factor
    borders: np.ndarray  # (3, D, AHEAD)
    corners: np.ndarray  # (3, AHEAD, AHEAD)
    steps: np.ndarray  # (3, D + AHEAD): gradient, step, and the one before


class Plan(NamedTuple):
    """How a fit is to go, see `level_fit`; pairs are those at first and when relaxed."""

    begin: int  # the first iteration; later ones are less stiff
    end: int
    stiffness: tuple[float, float]
    misplaced: tuple[float, float]  # px
    tukey_from: int  # the iteration from which on Tukey's loss counts, else Huber's
    lens: bool  # whether the defocus is unknown
    relinearise: float  # px
    stop: float  # px
    first_stop: float  # px, likewise of the first step
    late_stop: float  # px, likewise of the last ...
    enough: int  # ... from this iteration on


@njit(**INLINED)
def relaxed(pair, iteration):
    """Return what holds in an iteration."""
    return pair[0] * (pair[1] / pair[0]) ** min(1.0, iteration / RELAXED_AFTER)


@njit(**INLINED)
def count_instants(scene, exposure, control, step_px, room):
    """Write how many instants each row needs so that no point moves more than `step_px`."""
    count = math.ceil((scene.frame_rows + exposure) / RUN_STEP) + 1
    corner_runs(
        scene.row_times, exposure, control, scene.first_time, scene.knot_rows, RUN_STEP,
        room.along[:count], room.runs,
    )
    for r in range(room.runs.size):
        room.samples[r] = min(max(math.ceil(room.runs[r] / step_px) + 1, 2), MOST_INSTANTS)


@njit(**INLINED)
def move(control, extras, step, start_exposure, to_control, to_extras):
    """Write where a step leads from a path and its extras: no leap, nor beyond the knots."""
    dof = (step.size - AHEAD) // control.shape[0]
    for k in range(control.shape[0]):
        for e in range(control.shape[1]):
            to_control[k, e] = control[k, e] + (step[k * dof + e] if e < dof else 0.0)
    beyond = step.size - AHEAD
    for x in range(4):
        to_extras[x] = extras[x] + step[beyond + x]
    to_extras[4] = extras[4] + BIAS_SCALE * step[beyond + 4]
    exposure = extras[EXPOSED]
    change = min(max(step[beyond + EXPOSED], -LEAP * exposure), LEAP * exposure)
    to_extras[EXPOSED] = min(
        max(exposure + change, LEAST_CHANGE * start_exposure), MOST_CHANGE * start_exposure
    )
    to_extras[BLURRED] = min(
        max(extras[BLURRED] + step[beyond + BLURRED], DEFOCUS[0]), DEFOCUS[1]
    )


@njit(inline='always', **OPTIONS)
def work_off(desk, scene, room, control, extras, lens):
    """Do pieces of what is ordered, chunks of rows, until none is left."""
    chunks = scene.bounds.size - 1
    while True:
        chunk = taken(desk)
        if chunk >= chunks:
            return
        softened = extras[BLURRED] - scene.defocus
        if room.order[RENEWED] != 0.0:
            linearise(
                chunk, chunk + 1, scene.bounds, scene.fine, scene.softer, scene.half_rows,
                scene.half_columns, scene.rows, scene.times, room.samples, scene.places,
                scene.values, scene.inverse_depth, control, scene.first_time, scene.knot_rows,
                extras[EXPOSED], softened, scene.focal, scene.center, scene.level, scene.dof,
                extras, scene.tones, scene.gamma, room.order[SIGMA], room.order[MISPLACED],
                room.order[TUKEY] != 0.0, lens, room.begins, room.normals, room.gradients,
                room.residuals, room.jacobians, room.knots_of, room.edges, room.soft,
            )
        else:
            correct(
                chunk, chunk + 1, scene.bounds, scene.fine, scene.softer, scene.half_rows,
                scene.half_columns, scene.rows, scene.times, room.samples, scene.places,
                scene.values, scene.inverse_depth, control, scene.first_time, scene.knot_rows,
                extras[EXPOSED], softened, scene.focal, scene.center, scene.level, scene.dof,
                extras, scene.tones, scene.gamma, room.order[SIGMA], room.order[MISPLACED],
                room.order[TUKEY] != 0.0, lens, room.begins, room.normals, room.gradients,
                room.residuals, room.jacobians, room.knots_of, room.edges, room.soft,
            )
        hand_in(desk)


@njit(**OPTIONS)
def iterate(
    leads, desk, scene, room, plan, beliefs, step_px, sigma, control, extras, at_control,
    at_extras,
):
    """
    Iterate until the rows stand still; the thread that `leads` does, others help it.

    `control` (knots, 6) and `extras` (AHEAD,), the light, the exposure and the defocus, become the
    outcome of the last step, `at_...` where it was taken. The residuals' standard deviation is
    `sigma` at first. Of each thread but the leader everything but `desk` may be gone by the time
    it comes.

    Returns
    -------
    sigma : float
        Standard deviation of the residuals there [grey levels].
    cost : float
        Mean of their sizes, each at most `OUTLIER` [grey levels], infinite without any.
    used : float
        Share of the points that lie in the reference, 0..1.
    iteration : int
        The last one.
    width : int
        Of the bands of `room`.

    """
    chunks = scene.bounds.size - 1
    gradient, step, before = room.steps[0], room.steps[1], room.steps[2]
    unknowns = step.size - AHEAD
    start_exposure = extras[EXPOSED]
    share = 1.0
    moved = np.inf
    cost = np.inf
    used = 0.0
    width = 1
    iteration = plan.begin
    if leads:
        step[:] = 0.0
    while True:
        renewed = moved > plan.relinearise
        if leads:
            if renewed:
                count_instants(scene, extras[EXPOSED], control, step_px, room)
                moved = 0.0
            room.order[RENEWED] = renewed
            room.order[TUKEY] = iteration >= plan.tukey_from
            room.order[SIGMA] = sigma
            room.order[MISPLACED] = relaxed(plan.misplaced, iteration)
            set_out(desk)
        elif not wait_for_any(desk, chunks):
            break
        work_off(desk, scene, room, control, extras, plan.lens)
        if not leads:
            continue
        wait_for_all(desk, chunks)
        if renewed:
            width = max(room.knots_of[:, 1].max(), 2 * scene.dof + 1)
        size = unknowns * width
        band = room.bands[0, :size].reshape(unknowns, width)
        if renewed:
            assemble(
                room.begins, scene.dof, room.normals, band, room.borders[0], room.corners[0]
            )
        assemble_gradient(room.begins, scene.dof, room.gradients, gradient)
        median, new_cost, new_used = spread(
            room.residuals, NO_RESIDUAL, OUTLIER, ROW_SEEN, room.bins, BINS_PER_LEVEL, room.seen
        )
        if new_used == 0.0:
            new_cost = np.inf
        done = iteration + 1 >= plan.end
        if iteration > plan.begin and new_cost > WORSE * cost + LITTLE_WORSE:
            for j in range(step.size):
                step[j] *= SHORTER
            moved = np.inf
        else:
            cost = new_cost
            used = new_used
            for k in range(control.shape[0]):
                for e in range(control.shape[1]):
                    at_control[k, e] = control[k, e]
            for x in range(AHEAD):
                at_extras[x] = extras[x]
            for j in range(step.size):
                before[j] = step[j]
            share, squared = next_step(
                beliefs, relaxed(plan.stiffness, iteration), control, extras[EXPOSED], sigma,
                band, room.borders[0], room.corners[0], gradient,
                room.bands[1, :size].reshape(unknowns, width), room.borders[1], room.corners[1],
                room.bands[2, :size].reshape(unknowns, width), room.borders[2], room.corners[2],
                before, share, scene.times, scene.first_time, scene.knot_rows, REACH, room.seen,
                step,
            )
            if used > 0.0:
                sigma = max(MIN_SIGMA, 1.4826 * median)
            row_step = math.sqrt(squared)
            moved += row_step
            stop = plan.first_stop if iteration == plan.begin else plan.stop
            if iteration + 1 >= plan.enough:
                stop = plan.late_stop
            done = done or (iteration >= RELAXED_AFTER and row_step < stop)
        move(at_control, at_extras, step, start_exposure, control, extras)
        if done:
            close(desk)
            break
        iteration += 1
    return sigma, cost, used, iteration, width
