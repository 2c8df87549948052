"""A small flight as a bag, a video and a folder of images."""

import cv2
import numpy as np
import pytest
from small_flight import COLS, ROWS, flown, masks_of

from rsmb_ros.bags.writing import BagFactory
from rsmb_ros.replay.job import ReplayJob, replay


@pytest.fixture(scope='session')
def factory():
    """Make messages for bags."""
    return BagFactory()


@pytest.fixture(scope='session')
def photos(texture_of):
    """Reference and six live frames some pixels apart; a box from the third one on."""
    ground = texture_of(ROWS + 24, COLS + 24, 5)
    moves = ((0, 0), (2, 1), (-2, 0), (1, -2), (0, 2), (3, 0), (-1, -1))
    images = []
    for n, (dx, dy) in enumerate(moves):
        image = ground[12 + dy : 12 + dy + ROWS, 12 + dx : 12 + dx + COLS].copy()
        if n >= 3:
            image[30 - dy : 50 - dy, 60 - dx : 84 - dx] = 250 - 10 * (np.arange(24) % 7)
        images.append(image)
    return images


@pytest.fixture(scope='session')
def flight_bag(photos, factory, tmp_path_factory):
    """Bag with /reference/image once and /image six times, 4 Hz."""
    return flown(tmp_path_factory.mktemp('bag') / 'flight.mcap', factory, photos)


@pytest.fixture(scope='session')
def image_folder(photos, tmp_path_factory):
    """Folder with shot_7.png to shot_12.png."""
    folder = tmp_path_factory.mktemp('folder')
    for n, photo in enumerate(photos[1:], 7):
        cv2.imwrite(str(folder / f'shot_{n}.png'), photo)
    (folder / 'notes.txt').write_text('no image')
    return folder


@pytest.fixture(scope='session')
def video_file(photos, tmp_path_factory):
    """Lossy film of the live frames, 8 Hz."""
    path = tmp_path_factory.mktemp('film') / 'flight.avi'
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 8.0, (COLS, ROWS))
    if not writer.isOpened():
        pytest.skip('this OpenCV writes no video')
    for photo in photos[1:]:
        writer.write(cv2.cvtColor(photo, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.fixture
def replayed(tmp_path):
    """Return a function that replays and returns summary and {stamp: change mask}."""

    def run(source, name='out', **options):
        out = tmp_path / f'{name}.mcap'
        summary = replay(ReplayJob(source, out, **options))
        return summary, masks_of(out)

    return run
