"""The Fast DDS profile is used unless the user chose or there is no room for it."""

import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import pytest

from rsmb_ros.ros import transport
from rsmb_ros.ros.transport import PROFILE, apply_profile

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


@pytest.fixture
def shared_memory(monkeypatch, tmp_path):
    """Return a function that sets how much shared memory is free, in MiB; 1000 at first."""

    def set_free(mib):
        usage = SimpleNamespace(free=mib * 2**20)
        monkeypatch.setattr(transport.shutil, 'disk_usage', lambda _: usage)
        return tmp_path

    set_free(1000)
    return set_free


@pytest.mark.parametrize('middleware', [{}, {'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}])
def test_profile_is_applied_when_nothing_was_chosen(tmp_path, shared_memory, middleware):
    environment = dict(middleware)
    assert 'fastdds_shm.xml' in apply_profile(environment, tmp_path, tmp_path)
    assert environment[VARIABLE] == str(PROFILE)


@pytest.mark.parametrize(
    'chosen',
    [
        {VARIABLE: '/mine.xml'},
        {'FASTDDS_DEFAULT_PROFILES_FILE': '/mine.xml'},
        {'FASTDDS_BUILTIN_TRANSPORTS': 'LARGE_DATA'},
        {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'},
    ],
)
def test_choice_of_the_user_stands_and_is_named(tmp_path, shared_memory, chosen):
    environment = dict(chosen)
    (value,) = chosen.values()
    assert value in apply_profile(environment, tmp_path, tmp_path)
    assert environment == chosen


def test_profile_in_the_working_directory_stands(tmp_path, shared_memory):
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<dds/>')
    environment = {}
    assert 'DEFAULT_FASTRTPS_PROFILES.xml' in apply_profile(environment, tmp_path, tmp_path)
    assert environment == {}


def test_profile_without_room_is_not_applied_and_the_remedy_is_named(tmp_path, shared_memory):
    shared_memory(64)  # the default of a container
    environment = {}
    note = apply_profile(environment, tmp_path, tmp_path)
    assert '64 MiB free' in note
    assert '--shm-size' in note
    assert environment == {}


def test_profile_is_not_applied_where_there_is_no_shared_memory(tmp_path):
    environment = {}
    assert '0 MiB free' in apply_profile(environment, tmp_path, tmp_path / 'none')
    assert environment == {}


def test_profile_has_room_for_a_1080p_colour_image_several_times():
    tree = ElementTree.parse(PROFILE).getroot()
    sizes = {
        name: int(tree.find(f'.//{{*}}{name}').text) for name in ('segment_size', 'maxMessageSize')
    }
    image = 1920 * 1080 * 3
    assert sizes['maxMessageSize'] > image
    assert sizes['segment_size'] >= 10 * image
