"""How far long work is, on a terminal; nothing in a pipe."""

import io
import sys
import threading

import pytest

from rsmb_ros.cli.progress import narrated

WORK = ('drawing 640x480', 1, 'timing 640x480', 2, 3)


class Terminal(io.StringIO):
    """A terminal that remembers what was written to it."""

    def isatty(self):
        return True


@pytest.fixture
def terminal(monkeypatch):
    """Return a function that makes stderr a terminal; a test calls it, pytest swaps stderr too."""

    def make():
        monkeypatch.setenv('TERM', 'xterm')
        monkeypatch.setattr(sys, 'stderr', Terminal())
        return sys.stderr

    return make


def test_pipe_gets_the_items_and_no_word(capsys):
    assert list(narrated(WORK, 3, 'speed')) == [1, 2, 3]
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ('', '')


def test_terminal_is_told_what_is_done_before_it_is_done(terminal):
    screen, told = terminal(), []
    for item in narrated(WORK, 3, 'speed'):
        told.append((item, 'drawing 640x480' in screen.getvalue(), screen.getvalue()))
    assert [(item, drawing) for item, drawing, _ in told] == [(1, True), (2, True), (3, True)]
    assert ['timing 640x480' in text for *_, text in told] == [False, True, True]
    assert '0/3' in told[0][2]
    assert '2/3' in told[2][2]


def test_no_thread_takes_time_from_what_is_measured(terminal):
    terminal()
    before = threading.active_count()
    for _ in narrated(WORK, 3, 'speed'):
        assert threading.active_count() == before
