"""Verbs, exit codes and the one line that says what was wrong."""

import re
import subprocess
import sys

import pytest

import rsmb_ros
from rsmb_ros.cli import detect
from rsmb_ros.cli.main import VERBS
from rsmb_ros.core.errors import BagError, ConfigError, FrameError

PAIR = ('detect', 'a.png', 'b.png', '-o', 'out')


def test_version_is_that_of_the_package(rsmb):
    done = rsmb('--version')
    assert (done.code, done.out) == (0, f'rsmb {rsmb_ros.__version__}\n')


def test_help_names_every_verb(rsmb):
    done = rsmb('--help')
    assert done.code == 0
    for verb in VERBS:
        assert re.search(rf'^ +{verb} ', done.out, re.MULTILINE)


@pytest.mark.parametrize('verb', VERBS)
def test_every_verb_has_help(rsmb, verb):
    done = rsmb(verb, '--help')
    assert done.code == 0
    others = {'evaluate': '--report', 'play': '--rate', 'speed': '--markdown'}
    output = {**others, 'ablation': '--markdown'}.get(verb, '--output')
    assert output in done.out


@pytest.mark.parametrize('arguments', [(), ('fly',), ('detect',), ('replay',)])
def test_wrong_usage_exits_with_2(rsmb, arguments):
    done = rsmb(*arguments)
    assert done.code == 2
    assert 'usage: rsmb' in done.err


def test_replay_says_what_an_output_is_needed_for(rsmb):
    done = rsmb('replay', 'a.mcap')
    assert done.code == 2
    assert '-o OUT.mcap is missing' in done.err


@pytest.mark.parametrize(
    ('error', 'code', 'line'),
    [
        (ConfigError('a.b = 1'), 2, 'rsmb: error: a.b = 1\n'),
        (BagError('x.mcap: no'), 1, 'rsmb: error: x.mcap: no\n'),
        (FrameError('too small'), 1, 'rsmb: error: too small\n'),
        (
            OSError(28, 'No space left on device', 'o'),
            1,
            'rsmb: error: o: No space left on device\n',
        ),
        (KeyboardInterrupt(), 130, 'rsmb: error: interrupted; what was finished is kept\n'),
    ],
)
def test_each_trouble_has_its_exit_code_and_one_line(rsmb, monkeypatch, error, code, line):
    def run(args):
        raise error

    monkeypatch.setattr(detect, 'run', run)
    done = rsmb(*PAIR)
    assert (done.code, done.err, done.out) == (code, line, '')


def test_help_comes_without_loading_what_verbs_need():
    code = (
        'import sys\n'
        'from rsmb_ros.cli.main import main\n'
        'try: main(["--help"])\n'
        'except SystemExit: pass\n'
        'sys.exit(any(name in sys.modules for name in ("rosbags", "rclpy", "jinja2")))\n'
    )
    subprocess.run([sys.executable, '-c', code], check=True, timeout=120, capture_output=True)
