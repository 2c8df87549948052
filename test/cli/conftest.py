"""A small pair of images, a small bag with truth, and the command in this process."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.cli.main import main

FOCAL_PX = 150.0
STEP_NS = 200_000_000
START_NS = 1_000_000_000_000
ROWS, COLS = 120, 160
CAR = (28, 24)  # px wide, high


@dataclass(frozen=True)
class Flight:
    """A textured plane seen from places some pixels apart; a car from frame 2 on."""

    reference: np.ndarray
    live: tuple[np.ndarray, ...]
    cars: tuple[tuple[int, int, int, int] | None, ...]  # x, y, width, height [px]

    def stamps(self):
        """Stamps of the live frames [ns]."""
        return [START_NS + (index + 1) * STEP_NS for index in range(len(self.live))]


@pytest.fixture(scope='session')
def flight():
    """Return four live frames and their reference, 160 x 120 px."""
    rng = np.random.default_rng(20170307)
    noise = cv2.GaussianBlur(rng.normal(size=(ROWS + 40, COLS + 40)), (0, 0), 2.0)
    ground = 128 + 45 * noise / noise.std()
    texture = rng.integers(0, 2, (6, 7)) * 235.0 + 10
    texture = cv2.resize(texture, CAR, interpolation=cv2.INTER_NEAREST)

    def photo(dx, dy, car):
        view = ground[20 + dy : 20 + dy + ROWS, 20 + dx : 20 + dx + COLS].copy()
        if car is not None:
            x, y, width, height = car
            view[y : y + height, x : x + width] = texture
        noisy = view + rng.normal(0, 1.5, view.shape)
        return np.clip(noisy, 0, 255).astype(np.uint8)

    moves = ((5, 0), (-4, 3), (0, -6), (7, 2))
    cars = tuple((90 - dx, 40 - dy, *CAR) if n >= 2 else None for n, (dx, dy) in enumerate(moves))
    live = tuple(photo(*move, car) for move, car in zip(moves, cars, strict=True))
    return Flight(photo(0, 0, None), live, cars)


@pytest.fixture(scope='session')
def image_files(flight, tmp_path_factory):
    """Return the folder with reference.png and live_0.png to live_3.png."""
    folder = tmp_path_factory.mktemp('images')
    cv2.imwrite(str(folder / 'reference.png'), flight.reference)
    for index, image in enumerate(flight.live):
        cv2.imwrite(str(folder / f'live_{index}.png'), image)
    return folder


@pytest.fixture(scope='session')
def factory():
    """Make messages for bags."""
    return BagFactory()


@pytest.fixture(scope='session')
def flight_bag(flight, factory, tmp_path_factory):
    """Return a bag of the flight with truth; images are compressed without loss."""
    path = tmp_path_factory.mktemp('bag') / 'flight.mcap'

    def compressed(header, image):
        return factory.compressed(header, cv2.imencode('.png', image)[1].tobytes(), 'png')

    with BagWriter(path) as bag:
        reference = compressed(factory.header(START_NS, 'map'), flight.reference)
        bag.write('/reference/image/compressed', reference, START_NS, latched=True)
        for stamp, image, car in zip(flight.stamps(), flight.live, flight.cars, strict=True):
            header = factory.header(stamp, 'cam')
            truth = {'objects': {} if car is None else {'car': car}}
            bag.write('/camera_info', factory.camera_info(header, image.shape, FOCAL_PX), stamp)
            bag.write('/image/compressed', compressed(header, image), stamp)
            bag.write('/truth/scene', factory.text(json.dumps(truth)), stamp)
    return path


@pytest.fixture(scope='session')
def focal_px():
    """Focal length in the camera_info of the bag [px]."""
    return FOCAL_PX


@dataclass(frozen=True)
class Outcome:
    """What a command left."""

    code: int
    out: str
    err: str


@pytest.fixture
def rsmb(capsys):
    """Return a function that runs ``rsmb`` with its arguments in this process."""

    def run(*arguments: str | Path | float) -> Outcome:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as error:  # argparse
            code = error.code
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return run
