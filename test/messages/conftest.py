"""Stand-ins with the fields of ROS messages: the conversions know no message library."""

from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture
def image_msg():
    """Return a factory of sensor_msgs/Image look-alikes from stored bytes."""

    def make(encoding, height, width, data, step=None, is_bigendian=0):
        data = np.frombuffer(data, np.uint8) if isinstance(data, bytes) else data
        stored = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
        if step is None:
            step = stored.size // height
        return SimpleNamespace(
            encoding=encoding,
            height=height,
            width=width,
            step=step,
            is_bigendian=is_bigendian,
            data=stored,
        )

    return make


@pytest.fixture
def compressed_msg():
    """Return a factory of sensor_msgs/CompressedImage look-alikes."""
    return lambda text, data: SimpleNamespace(format=text, data=np.frombuffer(data, np.uint8))
