"""One home of every default, unit and range; nothing is repaired silently."""

from __future__ import annotations

import pytest

from rsmb_ros.core import Config, ConfigError
from rsmb_ros.core.config import parameters


def test_defaults_are_inside_their_ranges():
    for parameter in parameters():
        assert parameter.check(parameter.default) == parameter.default
        assert parameter.doc
        assert parameter.allowed()


def test_nested_and_dotted_keys_mean_the_same():
    nested = Config.from_mapping({'shutter': {'exposure_rows': 40.0}})
    assert nested == Config.from_mapping({'shutter.exposure_rows': 40.0})
    assert nested.shutter.exposure_rows == 40.0
    assert nested.camera == Config().camera


def test_a_whole_number_is_a_float_where_one_is_wanted():
    assert Config.from_mapping({'shutter.exposure_rows': 40}).shutter.exposure_rows == 40.0


@pytest.mark.parametrize(
    ('key', 'value', 'said'),
    [
        ('shutter.exposure_rows', -1.0, '0 to 5000 rows'),
        ('shutter.exposure_rows', float('nan'), '0 to 5000 rows'),
        ('shutter.exposure_rows', '40', 'must be a float'),
        ('shutter.readout', 'sideways', 'one of top_down, bottom_up'),
        ('layers.enabled', 1, 'must be a bool'),
        ('registration.degrees_of_freedom', 5, 'one of 2, 3, 4, 6'),
        ('worker.threads', 0, '1 to 64'),
    ],
)
def test_bad_values_are_refused_with_key_value_and_range(key, value, said):
    with pytest.raises(ConfigError) as error:
        Config.from_mapping({key: value})
    assert key in str(error.value)
    assert repr(value) in str(error.value)
    assert said in str(error.value)


def test_misspelt_key_names_the_near_one():
    with pytest.raises(ConfigError, match=r'exposure_row.*did you mean shutter\.exposure_rows'):
        Config.from_mapping({'shutter': {'exposure_row': 1.0}})


def test_persistence_cannot_ask_for_more_frames_than_it_keeps():
    with pytest.raises(ConfigError, match=r'persistence_seen = 3 .*persistence_frames = 2'):
        Config.from_mapping({'change': {'persistence_seen': 3, 'persistence_frames': 2}})
    three_of_five = Config.from_mapping(
        {'change': {'persistence_seen': 3, 'persistence_frames': 5}, 'shutter.exposure_rows': 9}
    )
    assert three_of_five.for_one_frame() == Config.from_mapping({'shutter.exposure_rows': 9})


def test_thresholds_must_be_in_order():
    with pytest.raises(ConfigError, match='threshold_low'):
        Config.from_mapping({'change.threshold_low': 5.0})
