"""Results out: contents of every output, equal for every message library."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rsmb_ros.core.errors import FrameError
from rsmb_ros.core.types import NOT_REGISTERED, REGISTERED, Region, Result
from rsmb_ros.messages.as_json import result_to_dict, summary_to_dict, to_json
from rsmb_ros.messages.factory import image_fields, rows_fields
from rsmb_ros.messages.images import image_from_msg
from rsmb_ros.messages.outputs import IMAGE, OUTPUTS, ROWS, TEXT
from rsmb_ros.messages.stamps import stamp_ns

ROWS_M, COLS_N = 4, 6
HEADER = SimpleNamespace(stamp=SimpleNamespace(sec=12, nanosec=34), frame_id='cam')


class Views:
    """Counts how often the expensive pictures were asked for."""

    def __init__(self):
        self.asked = []

    def registered(self):
        self.asked.append('registered')
        return np.full((ROWS_M, COLS_N), 7, np.uint8)

    def rectified(self):
        self.asked.append('rectified')
        return np.full((ROWS_M, COLS_N, 3), 8, np.uint8)


class RecordingFactory:
    """Keeps what a message would be made of."""

    def image(self, header, array):
        return ('image', header, array)

    def text(self, text):
        return ('text', text)

    def rows(self, array, labels):
        return ('rows', array, labels)


@pytest.fixture
def make_result():
    def make(status=REGISTERED, motion=0.0):
        return Result(
            status=status,
            reason='' if status == REGISTERED else 'no texture',
            change_mask=np.full((ROWS_M, COLS_N), 255, np.uint8),
            valid_mask=np.full((ROWS_M, COLS_N), 254, np.uint8),
            residual=np.linspace(-9, 9, ROWS_M * COLS_N, dtype=np.float32).reshape(ROWS_M, -1),
            row_motion=np.full((ROWS_M, 6), motion) + np.arange(6),
            row_uncertainty=np.full(ROWS_M, 0.25),
            regions=(Region(1, 2, 3, 4, 11, 'change', np.float32(0.5)),),
            exposure_rows=20.0 if status == REGISTERED else math.nan,
            gain=1.5,
            timings_ms={'coarse': 2.5},
            views=Views(),
        )

    return make


def test_outputs_are_those_of_the_contract():
    assert {output.name: output.type for output in OUTPUTS} == {
        'registered': IMAGE,
        'rectified': IMAGE,
        'change_mask': IMAGE,
        'valid_mask': IMAGE,
        'residual': IMAGE,
        'overlay': IMAGE,
        'row_motion': ROWS,
        'regions_json': TEXT,
    }


@pytest.mark.parametrize(
    'name', ['registered', 'rectified', 'change_mask', 'valid_mask', 'residual']
)
def test_picture_carries_the_array_of_its_name_and_the_header_of_the_frame(make_result, name):
    result = make_result()
    (output,) = (output for output in OUTPUTS if output.name == name)
    kind, header, array = output.build(result, None, RecordingFactory(), HEADER)
    assert kind == 'image'
    assert header is HEADER
    assert array is getattr(result, name)


def test_cheap_output_does_not_render_the_pictures(make_result):
    result = make_result()
    for output in OUTPUTS:
        if output.name in {'change_mask', 'row_motion', 'regions_json'}:
            output.build(result, None, RecordingFactory(), HEADER)
    assert result.views.asked == []


def test_row_motion_is_rows_by_components(make_result):
    result = make_result()
    (output,) = (output for output in OUTPUTS if output.name == 'row_motion')
    _, array, labels = output.build(result, None, RecordingFactory(), HEADER)
    assert array is result.row_motion
    assert labels == ('row', 'component')


def test_regions_json_says_what_was_found_and_when(make_result):
    (output,) = (output for output in OUTPUTS if output.name == 'regions_json')
    _, text = output.build(make_result(), None, RecordingFactory(), HEADER)
    assert json.loads(text) == {
        'stamp': {'sec': 12, 'nanosec': 34},
        'frame_id': 'cam',
        'status': 'registered',
        'reason': '',
        'exposure_rows': 20.0,
        'gain': 1.5,
        'regions': [
            {
                'bounding_box': {'x': 1, 'y': 2, 'width': 3, 'height': 4},
                'area_px': 11,
                'kind': 'change',
                'relative_depth': None,
                'score': 0.5,
                'id': None,
                'first_seen': None,
                'reference_x': None,
                'reference_y': None,
                'shadow_like': False,
            }
        ],
        'timings_ms': {'coarse': 2.5},
    }


def test_region_that_lasts_has_a_name_a_time_and_a_place(make_result):
    known = Region(1, 2, 3, 4, 11, 'change', 0.5, None, 7, 12_000_000_034, 20.5, 30.25)
    (region,) = summary_to_dict(replace(make_result(), regions=(known,)))['regions']
    assert region['id'] == 7
    assert region['first_seen'] == {'sec': 12, 'nanosec': 34}
    assert (region['reference_x'], region['reference_y']) == (20.5, 30.25)


def test_rows_are_named_with_their_units(make_result):
    rows = result_to_dict(make_result())['row_motion']
    assert len(rows) == ROWS_M
    assert rows[0] == {
        't_x_px': 0.0,
        't_y_px': 1.0,
        'r_z_deg': 2.0,
        'scale': 3.0,
        'r_x_deg': 4.0,
        'r_y_deg': 5.0,
        'uncertainty_px': 0.25,
    }


def test_unknown_numbers_are_null_in_strict_json(make_result):
    values = json.loads(to_json(result_to_dict(make_result(NOT_REGISTERED, motion=math.nan))))
    assert values['status'] == 'not_registered'
    assert values['reason'] == 'no texture'
    assert values['exposure_rows'] is None
    assert values['row_motion'][0]['t_x_px'] is None


def test_summary_without_a_message_names_no_stamp(make_result):
    assert not {'stamp', 'frame_id', 'row_motion'} & summary_to_dict(make_result()).keys()


@pytest.mark.parametrize(
    ('array', 'encoding', 'step'),
    [
        (np.arange(24, dtype=np.uint8).reshape(4, 6), 'mono8', 6),
        (np.arange(72, dtype=np.uint8).reshape(4, 6, 3), 'bgr8', 18),
        (np.linspace(-1, 1, 24, dtype=np.float32).reshape(4, 6), '32FC1', 24),
        (np.arange(48, dtype=np.uint8).reshape(4, 12)[:, ::2], 'mono8', 6),  # not contiguous
    ],
)
def test_image_fields_hold_the_pixels(array, encoding, step):
    fields = image_fields(array)
    assert (fields.height, fields.width, fields.encoding, fields.step) == (4, 6, encoding, step)
    assert fields.is_bigendian == 0
    stored = fields.data.view(array.dtype.newbyteorder('<')).reshape(array.shape)
    np.testing.assert_array_equal(stored, array)


def test_image_fields_are_read_back_by_the_reader():
    array = np.random.default_rng(5).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    msg = SimpleNamespace(**image_fields(array)._asdict())
    np.testing.assert_array_equal(image_from_msg(msg), array)


def test_rows_fields_have_the_strides_of_std_msgs():
    fields = rows_fields(np.arange(24.0).reshape(4, 6), ('row', 'component'))
    assert fields.dimensions == (('row', 4, 24), ('component', 6, 6))
    assert fields.data.dtype == np.float32
    np.testing.assert_array_equal(fields.data, np.arange(24))


def test_stamp_is_exact_in_nanoseconds():
    assert stamp_ns(SimpleNamespace(sec=1700000000, nanosec=999999999)) == 1700000000999999999


@pytest.mark.parametrize(('sec', 'nanosec'), [(-1, 0), (0, 1_000_000_000)])
def test_impossible_stamp_is_refused(sec, nanosec):
    with pytest.raises(FrameError, match=f'{sec} s {nanosec} ns'):
        stamp_ns(SimpleNamespace(sec=sec, nanosec=nanosec))
