"""One flight in every container and compression gives the same masks, byte by byte."""

import os
import re
from pathlib import Path

import pytest
from containers import KINDS, in_container
from small_flight import START_NS, STEP_NS, masks_of

from rsmb_ros.bags.check import check
from rsmb_ros.bags.reading import Bag
from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core.errors import BagError


@pytest.fixture(scope='session')
def measured_bag(photos, factory, tmp_path_factory):
    """Bag with the reference, camera_info and images; some messages at one time."""
    path = tmp_path_factory.mktemp('measured') / 'flight.mcap'
    with BagWriter(path) as bag:
        for n, photo in enumerate(photos):
            time_ns = START_NS + max(n, 1) * STEP_NS
            header = factory.header(time_ns, 'cam')
            topic = '/image' if n else '/reference/image'
            bag.write('/camera_info', factory.camera_info(header, photo.shape, 140.0), time_ns)
            bag.write(topic, factory.image(header, photo), time_ns)
    return path


@pytest.fixture(scope='session')
def wanted(measured_bag, tmp_path_factory):
    """Masks of the bag as it is."""
    from rsmb_ros.replay.job import ReplayJob, replay

    out = tmp_path_factory.mktemp('wanted') / 'out.mcap'
    replay(ReplayJob(measured_bag, out))
    return masks_of(out)


@pytest.mark.parametrize('kind', KINDS)
def test_masks_are_equal_in_every_container(measured_bag, wanted, replayed, tmp_path, kind):
    path = in_container(measured_bag, kind, tmp_path)
    summary, masks = replayed(path)
    assert (summary.frames, summary.skipped, summary.lost) == (6, 0, 0)
    assert summary.damaged == kind.endswith('without metadata')
    assert list(masks) == list(wanted)
    for mask, other in zip(masks.values(), wanted.values(), strict=True):
        assert mask.tobytes() == other.tobytes()
    assert any(mask.any() for mask in wanted.values())


def test_focal_length_survives_every_container(measured_bag, tmp_path):
    for kind in ('db3', 'bag lz4', 'mcap unchunked', 'folder mcap split'):
        (tmp_path / kind).mkdir()
        with Bag(in_container(measured_bag, kind, tmp_path / kind)) as bag:
            assert bag.focal_px() == 140.0


# -- bags of others ----------------------------------------------------------------------------

OTHERS = {
    'aruco_images.bag': r'/',
    'fiducial_board_611.bag': r'/',
    'rosbag2_own/mcap_talker': None,
    'rosbag2_own/mcap_wbag': None,
    'rosbag2_own/sqlite3_talker': None,
    'rosbag2_own/sqlite3_wbag': None,
}


@pytest.fixture(scope='session')
def other_bags():
    """Folder of real recordings; skips where it is absent."""
    root = Path(os.environ.get('RSMB_DATA', Path(__file__).parents[2] / '../shared/data'))
    if not (root / 'bags').is_dir():
        pytest.skip(f'no real bags at {root} (set RSMB_DATA)')
    return root / 'bags'


@pytest.mark.parametrize('name', OTHERS)
def test_real_bags_are_read_to_the_end(other_bags, name):
    report = check(other_bags / name)
    assert not report.damaged, report.lines
    topics = [line for line in report.lines if '/msg/' in line]
    assert topics
    assert all(re.search(r': (\d+) of \1 messages whole$', line) for line in topics)


@pytest.mark.parametrize('name', [name for name, images in OTHERS.items() if images])
def test_real_images_are_replayed(other_bags, name, replayed):
    with Bag(other_bags / name) as bag:
        images = [topic for topic in bag.topics if topic.is_image]
    summary, masks = replayed(other_bags / name, reference='@0', topic=images[0].name)
    assert summary.frames == images[0].count
    assert not next(iter(masks.values())).any()  # the reference itself


@pytest.mark.parametrize('name', [name for name, images in OTHERS.items() if not images])
def test_real_bags_without_images_say_what_they_have(other_bags, name, replayed):
    with pytest.raises(BagError, match=r'no live image topic; .*; the bag has '):
        replayed(other_bags / name, reference='@0')


def test_demo_bag_is_whole():
    report = check(Path(__file__).parents[2] / 'bags' / 'demo.mcap')
    assert not report.damaged
    assert '/image/compressed (sensor_msgs/msg/CompressedImage): 20 of 20 messages whole' in (
        report.lines
    )


def test_times_of_every_container_are_known(measured_bag, tmp_path):
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        with Bag(in_container(measured_bag, kind, tmp_path / kind)) as bag:
            first, last = bag.span_ns()
        assert first == START_NS + STEP_NS
        assert abs(last - (START_NS + 6 * STEP_NS)) <= 1  # the library's ends lie 1 ns behind
