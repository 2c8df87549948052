"""Arrays that are used again."""

from __future__ import annotations

import numpy as np

from rsmb_ros.core.workspace import Workspace, Workspaces


def test_an_array_is_used_again_where_it_is_large_enough():
    room = Workspace()
    first = room.array('a', (4, 5))
    assert np.shares_memory(first, room.array('a', (2, 3)))
    assert not np.shares_memory(first, room.array('a', (5, 5)))
    assert not np.shares_memory(room.array('a', (4, 5)), room.array('b', (4, 5)))
    assert room.array('a', (4,), np.float32).dtype == np.float32


def test_a_workspace_has_one_user_at_a_time():
    rooms = Workspaces()
    with rooms.lent() as one:
        with rooms.lent() as other:
            assert one is not other
        with rooms.lent() as again:
            assert again is other
