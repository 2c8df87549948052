"""The page of a replay tells of its recording, the same with any number of processes."""

import re

from rsmb_ros.bags.writing import BagWriter
from rsmb_ros.core import Config
from rsmb_ros.replay.job import ReplayJob, replay


def test_page_is_equal_byte_by_byte(flight_bag, tmp_path):
    config = Config().replaced({'change.persistence_frames': 3, 'change.persistence_seen': 2})
    pages = []
    for count in (1, 2):
        page = tmp_path / f'{count}.html'
        replay(
            ReplayJob(flight_bag, tmp_path / 'o.mcap', config=config, workers=count, report=page)
        )
        pages.append(page.read_text('utf-8'))
    assert pages[0] == pages[1]
    assert re.findall(r'id="change-(\d+)"', pages[0]) == ['1']
    assert 'change.persistence_seen' in pages[0].split('All parameters')[0]
    assert str(flight_bag) in pages[0]


def test_page_says_what_could_not_be_read(photos, factory, tmp_path):
    with BagWriter(tmp_path / 'b.mcap') as bag:
        for n, photo in enumerate((photos[0], photos[1], photos[2][:9, :9])):
            header = factory.header(n * 10**8, 'cam')
            bag.write('/image' if n else '/reference/image', factory.image(header, photo), n)
    page = tmp_path / 'r.html'
    replay(ReplayJob(tmp_path / 'b.mcap', tmp_path / 'o.mcap', report=page))
    assert '<p class="note">1 frame could not be read.</p>' in page.read_text('utf-8')
