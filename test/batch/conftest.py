"""Small recordings of a few frames, and the command in this process."""

import numpy as np
import pytest

from rsmb_ros.bags.recording import NAV_SAT_FIX
from rsmb_ros.bags.typestore import new
from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.batch.crew import LocalCrew
from rsmb_ros.cli.main import main
from rsmb_ros.core import Detector

ROWS, COLS = 96, 128
STEP_NS = 100_000_000


@pytest.fixture(scope='session')
def write_bag(texture_of):
    """
    Return a function that writes a bag with a reference and `frames` live frames.

    With `fixes`, it has one for each image.
    """
    factory = BagFactory()

    def write(path, seed, frames=2, fixes=False):
        path.parent.mkdir(parents=True, exist_ok=True)
        ground = texture_of(ROWS + 12, COLS + 12, seed)
        with BagWriter(path) as bag:
            for n in range(frames + 1):
                dx, dy = (0, 0) if n == 0 else (2 * (n % 3), n % 2)
                image = ground[6 + dy : 6 + dy + ROWS, 6 + dx : 6 + dx + COLS].copy()
                if n > 1:
                    image[30:50, 60:84] = 250 - 10 * (np.arange(24) % 7)
                header = factory.header(10**18 + n * STEP_NS, 'cam')
                topic = '/image' if n else '/reference/image'
                bag.write(topic, factory.image(header, image), 10**18 + n * STEP_NS)
                if fixes:
                    bag.write('/fix', _fix(header), 10**18 + n * STEP_NS)
        return path

    return write


def _fix(header):
    return new(
        NAV_SAT_FIX,
        header=header,
        status=new('sensor_msgs/msg/NavSatStatus', status=0, service=1),
        latitude=47.0,
        longitude=8.0,
        altitude=480.0,
        position_covariance=np.zeros(9),
        position_covariance_type=0,
    )


@pytest.fixture
def one_process(monkeypatch):
    """Replay in this process: nothing here depends on where."""
    from rsmb_ros.batch.tasks import carried_out

    class Crew(LocalCrew):
        def results(self, tasks, pulse):
            for task in tasks:
                pulse()
                yield carried_out(task)

    monkeypatch.setattr('rsmb_ros.cli.batch.LocalCrew', Crew)


@pytest.fixture
def detected(monkeypatch):
    """Stamps of the frames that are really processed, in this process."""
    found, detect = [], Detector.detect

    def counting(self, live, stamp=None):
        found.append(stamp)
        return detect(self, live, stamp)

    monkeypatch.setattr(Detector, 'detect', counting)
    return found


@pytest.fixture
def rsmb(capsys):
    """Return a function that runs ``rsmb``; returns exit code, lines of stdout, of stderr."""

    def run(*arguments):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as error:  # argparse
            code = error.code
        captured = capsys.readouterr()
        return code, captured.out.splitlines(), captured.err.splitlines()

    return run
