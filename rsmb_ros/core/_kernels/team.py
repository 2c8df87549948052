"""
Threads that work off pieces together within one call of a kernel, piece by piece as they can.

One thread leads: it sets out the pieces, takes part, and waits until all of them are handed in.
Others come when they can, if at all, and look for pieces until they are sent home. What they share
is a desk of their own: a thread that comes too late finds it closed and touches nothing else.
"""

from __future__ import annotations

from threading import Lock

import numpy as np
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from .geometry import INLINED
from .wait import give_way

DESK = 16  # numbers of a desk; those in use lie in cache lines of their own
NEXT, HANDED_IN = 0, 8
CLOSED = 1 << 40  # more than there are pieces

if config.DISABLE_JIT:
    _LOCK = Lock()

    def _fetch_add(numbers, at, change):
        with _LOCK:
            value = numbers[at]
            numbers[at] += change
        return value

    def _put(numbers, at, value):
        numbers[at] = value

    def _read(numbers, at):
        return numbers[at]
else:

    def _pointer(context, builder, kind, array, at):
        array = context.make_array(kind)(context, builder, array)
        return cgutils.get_item_pointer(context, builder, kind, array, [at], wraparound=False)

    @intrinsic
    def _fetch_add(typing_context, numbers, at, change):
        """Add to a number and return what it was, as one step among all threads."""

        def build(context, builder, signature, values):
            place = _pointer(context, builder, signature.args[0], values[0], values[1])
            return builder.atomic_rmw('add', place, values[2], 'seq_cst')

        return types.int64(numbers, types.intp, types.int64), build

    @intrinsic
    def _put(typing_context, numbers, at, value):
        """Write a number after all that was written before."""

        def build(context, builder, signature, values):
            place = _pointer(context, builder, signature.args[0], values[0], values[1])
            builder.store_atomic(values[2], place, 'seq_cst', 8)
            return context.get_dummy_value()

        return types.void(numbers, types.intp, types.int64), build

    @intrinsic
    def _read(typing_context, numbers, at):
        """Read a number before all that is read after it."""

        def build(context, builder, signature, values):
            place = _pointer(context, builder, signature.args[0], values[0], values[1])
            return builder.load_atomic(place, 'seq_cst', 8)

        return types.int64(numbers, types.intp), build


def new_desk() -> np.ndarray:
    """Return a desk (DESK,) int64 on which nothing lies yet."""
    desk = np.zeros(DESK, np.int64)
    desk[NEXT] = CLOSED - 1
    return desk


@njit(**INLINED)
def set_out(desk):
    """Set out pieces 0, 1, ... for all to take; the last ones must be handed in."""
    _put(desk, HANDED_IN, 0)
    _put(desk, NEXT, 0)


@njit(**INLINED)
def taken(desk):
    """Take a piece and return which; there is none beyond those that there are."""
    return _fetch_add(desk, NEXT, 1)


@njit(**INLINED)
def hand_in(desk):
    """Say that a piece is done."""
    _fetch_add(desk, HANDED_IN, 1)


@njit(**INLINED)
def wait_for_all(desk, pieces):
    """Return when all pieces are handed in."""
    while _read(desk, HANDED_IN) < pieces:
        give_way()


@njit(**INLINED)
def wait_for_any(desk, pieces):
    """Return True when there are pieces to take, False when there will be none any more."""
    while True:
        piece = _read(desk, NEXT)
        if piece < pieces:
            return True
        if piece >= CLOSED:
            return False
        give_way()


@njit(**INLINED)
def close(desk):
    """Send all home."""
    _put(desk, NEXT, CLOSED)
