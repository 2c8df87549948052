"""Small recordings of a few frames, and the command in this process."""

import numpy as np
import pytest

from rsmb_ros.bags.writing import BagFactory, BagWriter
from rsmb_ros.cli.main import main

ROWS, COLS = 96, 128
STEP_NS = 100_000_000


@pytest.fixture(scope='session')
def write_bag(texture_of):
    """Return a function that writes a bag with a reference and `frames` live frames."""
    factory = BagFactory()

    def write(path, seed, frames=2):
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
        return path

    return write


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
