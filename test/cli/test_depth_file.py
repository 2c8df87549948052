"""`--depth`: files of depth, the same for `rsmb detect` and `rsmb replay`."""

import re

import cv2
import numpy as np
import pytest

from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core import Camera, Detector


@pytest.fixture
def depth(flight):
    """A near square in the reference's middle, a hole beside it."""
    depth = np.ones(flight.reference.shape, np.float32)
    depth[40:80, 60:100] = 0.5
    depth[40:80, 20:40] = np.nan
    return depth


@pytest.fixture
def detect(rsmb, image_files, tmp_path):
    """Run ``rsmb detect`` with a depth file; returns outcome and the valid mask's path."""

    def run(*options):
        pair = image_files / 'reference.png', image_files / 'live_3.png'
        done = rsmb('detect', *pair, '-o', tmp_path / 'out', '--depth', *options)
        return done, tmp_path / 'out' / 'valid_mask.png'

    return run


def _npy(path, depth):
    np.save(path, depth)


def _metres(path, depth):
    np.save(path, depth.astype(np.float64) * 50)


def _image(path, depth):
    assert cv2.imwrite(str(path), depth)


def _millimetres(path, depth):
    _image(path, np.rint(np.nan_to_num(depth * 50_000, nan=0.0)).astype(np.uint16))


@pytest.mark.parametrize(
    ('name', 'write', 'options'),
    [
        ('depth.npy', _npy, ()),
        ('metres.npy', _metres, ('--depth-unit', '0.02')),
        ('depth.tiff', _image, ()),
        ('depth.png', _millimetres, ('--depth-unit', '2e-5')),
        ('mm.tiff', _millimetres, ('--depth-unit', '2e-5')),
    ],
)
def test_every_kind_of_file_is_the_detectors_depth(
    detect, flight, depth, tmp_path, name, write, options
):
    write(tmp_path / name, depth)
    done, valid = detect(tmp_path / name, *options)
    assert done.code == 0, done.err
    expected = Detector(flight.reference, depth=depth).detect(flight.live[3])
    assert expected.status == 'registered'
    found = cv2.imread(str(valid), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(found, expected.valid_mask)
    plain = Detector(flight.reference).detect(flight.live[3])
    assert np.mean(expected.valid_mask != plain.valid_mask) > 0.05, 'the hole is not judged'


@pytest.mark.parametrize(
    ('write', 'options', 'code', 'reason'),
    [
        (None, (), 1, 'x.npy: cannot be read: No such file'),
        (lambda p, d: p.write_bytes(b'text'), (), 1, 'x.npy: not a .npy file of numbers'),
        (lambda p, d: _npy(p, d[:-1]), (), 1, 'depth is 119x160 px but the reference is 120x160'),
        (_metres, (), 1, r'is 50 \(.* such pixels\), must be 0.05 to 20'),
        (lambda p, d: _npy(p, np.stack([d, d])), (), 1, r'holds float32 \(2, 120, 160\)'),
        (lambda p, d: _npy(p, np.ones(d.shape, np.uint16)), (), 2, '--depth-unit must say'),
        (_npy, ('--depth-unit', '0'), 2, "'0' must be a number from 1e-09"),
    ],
)
def test_what_is_no_depth_is_told(detect, depth, tmp_path, write, options, code, reason):
    if write is not None:
        write(tmp_path / 'x.npy', depth)
    done, valid = detect(tmp_path / 'x.npy', *options)
    assert done.code == code
    assert re.search(reason, done.err)
    assert not valid.exists()


def test_picture_of_an_unknown_kind_is_named(detect, tmp_path):
    (tmp_path / 'x.exr').write_bytes(b'text')
    done, _ = detect(tmp_path / 'x.exr')
    assert done.code == 1
    assert 'x.exr: not a depth map this OpenCV can read; must be .npy, PNG or TIFF' in done.err


def test_unit_without_a_file_is_wrong_usage(rsmb, image_files, tmp_path):
    pair = image_files / 'reference.png', image_files / 'live_0.png'
    done = rsmb('detect', *pair, '-o', tmp_path / 'out', '--depth-unit', '0.02')
    assert done.code == 2
    assert '--depth-unit is nothing without --depth FILE' in done.err


def test_replay_takes_it_too(rsmb, flight, flight_bag, depth, tmp_path, focal_px):
    np.save(tmp_path / 'depth.npy', depth)
    out = tmp_path / 'out.mcap'
    done = rsmb('replay', flight_bag, '-o', out, '--depth', tmp_path / 'depth.npy')
    assert done.code == 0, done.err
    detector = Detector(flight.reference, Camera(focal_px), depth=depth)
    with Bag(out) as bag:
        found = [frame.image for frame in bag.frames('/rsmb/valid_mask')]
    for image, live in zip(found, flight.live, strict=True):
        np.testing.assert_array_equal(image, detector.detect(live).valid_mask)


def test_depth_of_one_reference_is_not_taken_for_another(rsmb, flight, depth, tmp_path, factory):
    np.save(tmp_path / 'depth.npy', depth)
    path, out = tmp_path / 'two.mcap', tmp_path / 'out.mcap'
    series = [
        ('/reference/image', flight.reference),
        ('/image', flight.live[0]),
        ('/reference/image', flight.live[1]),
        ('/image', flight.live[2]),
    ]
    with BagWriter(path) as bag:
        for time, (topic, image) in enumerate(series, 1):
            bag.write(topic, factory.image(factory.header(time, ''), image), time)
    done = rsmb('replay', path, '-o', out, '--depth', tmp_path / 'depth.npy')
    assert done.code == 1
    assert 'another reference than the one --depth describes' in done.err
    with Bag(out) as bag:
        assert len(list(bag.frames('/rsmb/valid_mask'))) == 1, 'what was finished is kept'
