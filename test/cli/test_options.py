"""One configuration for node and command: the same file, the same names, the same refusals."""

import argparse
from pathlib import Path

import pytest

from rsmb_ros.cli.options import add_config_options, load_config
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import ConfigError, FileProblem

SHIPPED = Path(__file__).parents[2] / 'config' / 'rsmb.yaml'


@pytest.fixture
def load(tmp_path):
    """Return a function that loads the text of a file and ``--set`` options."""

    def load(text=None, *assignments):
        path = tmp_path / 'my.yaml'
        arguments = [part for one in assignments for part in ('--set', one)]
        if text is not None:
            path.write_text(text)
            arguments += ['--config', str(path)]
        parser = argparse.ArgumentParser()
        add_config_options(parser)
        return load_config(parser.parse_args(arguments))

    return load


def test_without_options_everything_is_default(load):
    assert load() == Config()


def test_shipped_file_is_the_default(load):
    assert load(SHIPPED.read_text()) == Config()


@pytest.mark.parametrize(
    'text',
    [
        'shutter: {exposure_rows: 40.0}',
        'shutter.exposure_rows: 40.0',
        '/**: {ros__parameters: {shutter: {exposure_rows: 40.0}}}',
        '/**:\n  ros__parameters:\n    shutter.exposure_rows: 40',
        'rsmb: {ros__parameters: {shutter: {exposure_rows: 40.0}}}',
        '/drone/rsmb: {ros__parameters: {shutter: {exposure_rows: 40.0}}}',
        'drone: {rsmb: {ros__parameters: {shutter: {exposure_rows: 40.0}}}}',
        'other: {ros__parameters: {x: 1}}\nrsmb: {ros__parameters: {shutter.exposure_rows: 40.0}}',
    ],
)
def test_file_of_the_node_and_plain_sections_mean_the_same(load, text):
    assert load(text) == Config().replaced({'shutter.exposure_rows': 40.0})


def test_what_only_the_node_has_is_ignored(load):
    text = (
        '/**:\n  ros__parameters:\n    image_transport: compressed\n    use_sim_time: true\n'
        '    qos_overrides: {/image: {subscription: {depth: 3}}}\n    worker: {threads: 1}\n'
    )
    assert load(text) == Config().replaced({'worker.threads': 1})


def test_empty_file_changes_nothing(load):
    assert load('# nothing yet\n') == Config()


def test_set_wins_over_the_file(load):
    config = load('change: {threshold_high: 6.0}', 'change.threshold_high=7')
    assert config.change.threshold_high == 7.0


@pytest.mark.parametrize(
    ('assignment', 'value'),
    [
        ('shutter.readout=bottom_up', 'bottom_up'),
        ('layers.enabled=false', False),
        ('registration.degrees_of_freedom=3', 3),
        ('change.min_area=1e-3', 0.001),
    ],
)
def test_set_reads_values_as_yaml(load, assignment, value):
    found = load(None, assignment).flat()[assignment.partition('=')[0]]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('shuter: {exposure_rows: 1.0}', r"my\.yaml: parameter 'shuter\.exposure_rows' is unknown"),
        ('shutter: {exposure_rows: -1}', r'my\.yaml: shutter\.exposure_rows = -1\.0 is not allow'),
        ('worker: {threads: two}', r"my\.yaml: worker\.threads = 'two' is a str, must be a int"),
        ('- 1\n- 2\n', r'my\.yaml: holds a list, must hold sections'),
        ('a: [1\n', r'my\.yaml: not YAML'),
        ('talker: {ros__parameters: {x: 1}}', r'holds parameters of /talker only; must name /\*\*'),
    ],
)
def test_file_with_a_mistake_is_named_and_told(load, text, message):
    with pytest.raises(ConfigError, match=message):
        load(text)


@pytest.mark.parametrize(
    ('assignment', 'message'),
    [
        ('shutter.exposure_rows', r"'shutter\.exposure_rows' must be SECTION\.KEY=VALUE"),
        ('shutter.exposure=1', r'did you mean shutter\.exposure_rows'),
        ('shutter.exposure_rows=[1', r'the value is not YAML'),
    ],
)
def test_set_with_a_mistake_is_told(load, assignment, message):
    with pytest.raises(ConfigError, match=message):
        load(None, assignment)


def test_missing_file_is_named(tmp_path):
    args = argparse.Namespace(config=tmp_path / 'gone.yaml', set=[])
    with pytest.raises(FileProblem, match=r'gone\.yaml: cannot be read: No such file'):
        load_config(args)


def test_mistakes_exit_with_2_and_missing_files_with_1(rsmb, image_files, tmp_path):
    pair = ('detect', image_files / 'reference.png', image_files / 'live_0.png', '-o', tmp_path)
    assert rsmb(*pair, '--set', 'change.area=1').code == 2
    assert rsmb(*pair, '--config', tmp_path / 'gone.yaml').code == 1
    assert list(tmp_path.iterdir()) == []
