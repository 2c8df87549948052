"""Small recordings in every format, made with the libraries' own writers."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from rsmb_ros.bags.writing import BagFactory, BagWriter

IMAGE = 'sensor_msgs/msg/Image'
STEP_NS = 100_000_000


@pytest.fixture(scope='session')
def factory():
    """Make messages for bags."""
    return BagFactory()


@pytest.fixture(scope='session')
def pictures(texture_of):
    """Three grey images, 24 x 32 px."""
    return [texture_of(24, 32, seed) for seed in (1, 2, 3)]


@pytest.fixture
def write_images(tmp_path, factory):
    """Return a writer of bags with the one topic /image: ``write(format, arrays) -> path``."""
    ros2, ros1 = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)

    def message(index, array):
        return factory.image(factory.header(index * STEP_NS, 'cam'), array)

    def rosbag2(folder, plugin, arrays):
        with Rosbag2Writer(folder, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection('/image', IMAGE, typestore=ros2)
            for index, array in enumerate(arrays):
                data = ros2.serialize_cdr(message(index, array), IMAGE)
                writer.write(connection, index * STEP_NS, data)
        return folder

    def rosbag1(path, arrays):
        header_class = ros1.types['std_msgs/msg/Header']
        with Rosbag1Writer(path) as writer:
            connection = writer.add_connection('/image', IMAGE, typestore=ros1)
            for index, array in enumerate(arrays):
                image = message(index, array)
                header = header_class(seq=index, stamp=image.header.stamp, frame_id='cam')
                fields = {name: getattr(image, name) for name in image.__dataclass_fields__}
                fields = {k: v for k, v in fields.items() if not k.startswith('_')}
                old = ros1.types[IMAGE](**{**fields, 'header': header})
                writer.write(connection, index * STEP_NS, ros1.serialize_ros1(old, IMAGE))
        return path

    def write(kind, arrays) -> Path:
        if kind == 'ros 1':
            return rosbag1(tmp_path / 'images.bag', arrays)
        if kind == 'our mcap':
            path = tmp_path / 'ours.mcap'
            with BagWriter(path) as writer:
                for index, array in enumerate(arrays):
                    writer.write('/image', message(index, array), index * STEP_NS)
            return path
        mcap = kind.endswith('mcap')
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        folder = rosbag2(tmp_path / 'folder', plugin, arrays)
        if kind.startswith('folder'):
            return folder
        (path,) = folder.glob('*.mcap' if mcap else '*.db3')
        return path

    return write


@pytest.fixture
def write_topics(tmp_path, factory):
    """Return a writer of a bag with one message per topic: ``write({topic: message}) -> path``."""

    def write(messages) -> Path:
        path = tmp_path / 'topics.mcap'
        with BagWriter(path) as writer:
            for topic, message in messages.items():
                writer.write(topic, message, 0)
        return path

    return write


@pytest.fixture
def blank(factory):
    """An Image message of a dark picture."""
    return factory.image(factory.header(0, ''), np.zeros((4, 4), np.uint8))
