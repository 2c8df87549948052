"""What cannot be written is told before the work begins."""

import os
import shutil
from pathlib import Path

import pytest

from rsmb_ros.cli.main import main
from rsmb_ros.core.errors import ConfigError, FileProblem
from rsmb_ros.replay.job import ReplayJob
from rsmb_ros.replay.targets import check_targets, paths_named


def test_files_in_a_folder_that_is_there_are_fine(tmp_path):
    (tmp_path / 'old.csv').write_text('will be replaced')
    check_targets(
        {'-o': tmp_path / 'o.mcap', '--csv': tmp_path / 'old.csv'}, {'the bag': tmp_path / 'i.mcap'}
    )


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileProblem, match=r'there is no folder .*gone; create it first'):
        check_targets({'--csv': tmp_path / 'gone' / 'o.csv'}, {})


def test_file_in_place_of_a_folder_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(FileProblem, match='file is no folder'):
        check_targets({'--csv': tmp_path / 'file' / 'o.csv'}, {})


def test_folder_in_place_of_a_file_is_named(tmp_path):
    (tmp_path / 'o.csv').mkdir()
    with pytest.raises(FileProblem, match='it is a folder; name a file'):
        check_targets({'--csv': tmp_path / 'o.csv'}, {})


@pytest.mark.parametrize('is_there', [False, True])
def test_what_may_not_be_written_is_named(tmp_path, monkeypatch, is_there):
    path = tmp_path / 'o.csv'
    if is_there:
        path.write_text('')
    asked = []

    def deny(place, mode):  # root may write everywhere
        asked.append((Path(place), mode))
        return False

    monkeypatch.setattr(os, 'access', deny)
    with pytest.raises(FileProblem, match=r'o\.csv: cannot be written: permission denied'):
        check_targets({'--csv': path}, {})
    assert asked == [(path if is_there else tmp_path, os.W_OK)]


def test_output_is_never_an_input_under_whatever_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bag = tmp_path / 'bag.mcap'
    bag.write_text('data')
    (tmp_path / 'link.csv').symlink_to(bag)
    for target in (bag, Path('bag.mcap'), tmp_path / 'link.csv'):
        with pytest.raises(ConfigError, match='is the bag to be read; choose another name'):
            check_targets({'--csv': target}, {'the bag': bag})


def test_file_of_a_folder_that_is_read_is_not_replaced(tmp_path):
    (tmp_path / 'bag_0.mcap').write_text('data')
    with pytest.raises(ConfigError, match='choose another name'):
        check_targets({'-o': tmp_path / 'bag_0.mcap'}, {'the bag': tmp_path})
    check_targets({'-o': tmp_path / 'new.mcap'}, {'the bag': tmp_path})


def test_two_outputs_are_never_one_file(tmp_path):
    path = tmp_path / 'same'
    with pytest.raises(ConfigError, match=r'--jsonl \S+same is also that of --csv'):
        check_targets({'--csv': path, '--jsonl': tmp_path / '.' / 'same'}, {})


@pytest.mark.parametrize('reference', ['{}', '{}@0', '{}:/image@1.5', '/image@0', '/image', '@3'])
def test_files_in_a_reference_are_found(tmp_path, reference):
    (tmp_path / 'other.mcap').write_text('data')
    found = paths_named(reference.format(tmp_path / 'other.mcap'))
    assert found == ([tmp_path / 'other.mcap'] if '{}' in reference else [])


def test_recording_of_the_reference_is_not_replaced(flight_bag, tmp_path):
    other = tmp_path / 'other.mcap'
    shutil.copy(flight_bag, other)
    with pytest.raises(ConfigError, match='is the reference to be read; choose another name'):
        ReplayJob(flight_bag, other, reference=f'{other}@0')


def test_configuration_is_not_replaced(flight_bag, tmp_path, capsys):
    config = tmp_path / 'rsmb.yaml'
    config.write_text('camera: {focal_px: 200.0}')
    words = ['replay', flight_bag, '-o', tmp_path / 'o.mcap', '--config', config, '--csv', config]
    assert main([str(word) for word in words]) == 2
    assert 'is --config to be read; choose another name' in capsys.readouterr().err
    assert config.read_text() == 'camera: {focal_px: 200.0}'
