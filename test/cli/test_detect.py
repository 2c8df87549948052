"""`rsmb detect`: two image files in, masks, pictures and JSON out."""

import json

import cv2
import numpy as np
import pytest

import rsmb_ros
from rsmb_ros.core import Config, Detector

PICTURES = ('change_mask', 'valid_mask', 'registered', 'rectified', 'residual', 'overlay')


def read(path):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, f'{path} is no image'
    return image


@pytest.fixture
def detect(rsmb, image_files, tmp_path):
    """Run ``rsmb detect`` on files of the flight; returns outcome and folder."""

    def run(live, *options, reference='reference.png'):
        out = tmp_path / 'deep' / 'out'
        return rsmb('detect', image_files / reference, image_files / live, '-o', out, *options), out

    return run


def test_writes_what_the_detector_finds(detect, flight):
    done, out = detect('live_2.png')
    assert done.code == 0
    expected = Detector(flight.reference).detect(flight.live[2])
    for name in ('change_mask', 'valid_mask', 'registered', 'rectified'):
        np.testing.assert_array_equal(read(out / f'{name}.png'), getattr(expected, name))
    residual = np.clip(np.rint(128 + expected.residual), 0, 255)
    np.testing.assert_array_equal(read(out / 'residual.png'), residual)
    assert read(out / 'overlay.png').shape == (*flight.live[2].shape, 3)
    assert {path.name for path in out.iterdir()} == {f'{p}.png' for p in PICTURES} | {'result.json'}


def test_json_has_result_configuration_and_version(detect, flight):
    _, out = detect('live_2.png', '--set', 'change.threshold_high=4.5')
    found = json.loads((out / 'result.json').read_text())
    assert (found['status'], found['version']) == ('registered', rsmb_ros.__version__)
    assert Config.from_mapping(found['config']).change.threshold_high == 4.5
    assert len(found['row_motion']) == flight.live[2].shape[0]
    (region,) = found['regions']
    x, y, width, height = flight.cars[2]
    assert region['kind'] == 'change'
    box = region['bounding_box']
    found_box = [box[name] for name in ('x', 'y', 'width', 'height')]
    np.testing.assert_allclose(found_box, (x, y, width, height), atol=8)  # px, its rim


def test_a_pair_is_judged_alone_whatever_a_stream_would_wait_for(detect):
    _, out = detect(
        'live_2.png',
        *('--set', 'change.persistence_frames=5', '--set', 'change.persistence_seen=3'),
    )
    found = json.loads((out / 'result.json').read_text())
    assert [region['kind'] for region in found['regions']] == ['change']
    assert found['config']['change']['persistence_seen'] == 1


def test_one_line_says_what_came_out(detect):
    done, out = detect('live_2.png')
    assert done.out.count('\n') == 1
    assert done.out.startswith('registered | 1 change | 0 static objects')
    assert str(out) in done.out
    assert done.err == ''


def test_not_registered_is_a_result(rsmb, image_files, tmp_path, texture_of):
    cv2.imwrite(str(tmp_path / 'other.png'), texture_of(120, 160, 99))
    done = rsmb('detect', image_files / 'reference.png', tmp_path / 'other.png', '-o', tmp_path)
    assert done.code == 0
    assert done.out.startswith('not registered: ')
    found = json.loads((tmp_path / 'result.json').read_text())
    assert found['status'] == 'not_registered'
    assert found['reason'] in done.out
    assert not read(tmp_path / 'change_mask.png').any()
    assert not read(tmp_path / 'valid_mask.png').any()


def test_file_of_the_user_beside_the_outputs_is_left_alone(detect, tmp_path):
    (tmp_path / 'deep' / 'out').mkdir(parents=True)
    (tmp_path / 'deep' / 'out' / 'notes.txt').write_text('mine')
    _, out = detect('live_0.png')
    assert (out / 'notes.txt').read_text() == 'mine'


@pytest.mark.parametrize('swap', [False, True], ids=['live', 'reference'])
def test_missing_file_is_named(detect, swap):
    names = ('reference.png', 'gone.png')
    reference, live = reversed(names) if swap else names
    done, out = detect(live, reference=reference)
    assert done.code == 1
    assert done.err.endswith('gone.png: cannot be read: No such file or directory\n')
    assert not out.exists()


@pytest.mark.parametrize(
    ('name', 'keep', 'reason'),
    [
        ('notes.txt', None, "4 bytes of format 'txt' cannot be decoded, must be a JPEG or PNG"),
        ('empty.png', 0, 'has no data'),
        ('cut.png', 2000, 'cut off: 2000 bytes without its end'),
    ],
)
def test_file_that_is_no_image_is_named(rsmb, image_files, tmp_path, name, keep, reason):
    whole = (image_files / 'live_0.png').read_bytes()
    (tmp_path / name).write_bytes(b'text' if keep is None else whole[:keep])
    out = tmp_path / 'out'
    done = rsmb('detect', image_files / 'reference.png', tmp_path / name, '-o', out)
    assert done.code == 1
    said = ' '.join(done.err.split())  # a long path may wrap the line
    assert f'{name}: not an image: ' in said
    assert reason in said
    assert not out.exists()


def test_tiny_image_is_named_with_its_size(rsmb, image_files, tmp_path):
    cv2.imwrite(str(tmp_path / 'tiny.png'), np.zeros((8, 8), np.uint8))
    done = rsmb('detect', image_files / 'reference.png', tmp_path / 'tiny.png', '-o', tmp_path)
    assert done.code == 1
    assert 'live frame is 8x8 px, must be at least 32x32' in done.err


def test_output_that_is_a_file_is_named(rsmb, image_files, tmp_path):
    (tmp_path / 'out').write_text('mine')
    pair = (image_files / 'reference.png', image_files / 'live_0.png')
    done = rsmb('detect', *pair, '-o', tmp_path / 'out')
    assert done.code == 1
    assert f'{tmp_path / "out"}: cannot be made a folder' in done.err
    assert (tmp_path / 'out').read_text() == 'mine'
