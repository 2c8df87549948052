"""A buffer is lent to one owner at a time, and lent again when that one is gone."""

from __future__ import annotations

import gc

from rsmb_ros.core.buffers import Buffers


class Owner:
    """What can be referred to weakly."""


def test_a_buffer_is_used_again_when_its_owner_is_gone():
    buffers = Buffers()
    one, other = Owner(), Owner()
    first = buffers.lend(one, (4, 5))
    second = buffers.lend(other, (4, 5))
    assert first.shape == (4, 5)
    assert first is not second
    del one
    gc.collect()
    assert buffers.lend(Owner(), (4, 6)) is not first
    assert buffers.lend(other, (4, 5)) is first
    assert buffers.lend(other, (4, 5)) is not second
