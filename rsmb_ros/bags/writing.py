"""Recordings as one .mcap file that every ROS 2 tool reads."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

import rsmb_ros
from rsmb_ros.core.config import Config
from rsmb_ros.core.errors import BagError
from rsmb_ros.messages.as_json import to_json
from rsmb_ros.messages.factory import image_fields, rows_fields

_TYPES = get_typestore(Stores.ROS2_JAZZY)
METADATA = 'rsmb'  # name of the record with version and configuration

# What rosbag2 of Jazzy writes for a publisher; `ros2 bag play` offers its topics like this. From a
# file without metadata of its own it takes names, not the numbers of older versions.
_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


class BagWriter:
    """
    Writes one .mcap; a context manager.

    The file appears under its name when the block is left, however it is left: an interrupted
    recording is shorter, never damaged. Until then it has the suffix ``.part``.

    Parameters
    ----------
    path : Path
        Must end in .mcap; an existing file is replaced.
    config : Config, optional
        Written into the file beside the version.

    Raises
    ------
    BagError
        If the name is wrong or the file cannot be written.

    """

    def __init__(self, path: Path, config: Config | None = None) -> None:
        if path.suffix != '.mcap':
            raise BagError(f'{path}: an output bag must be named *.mcap')
        self.path = path
        self._part = path.with_name(path.name + '.part')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence: dict[str, int] = {}
        try:
            self._stream = self._part.open('wb')
        except OSError as error:
            raise BagError(f'{path}: cannot be written: {error.strerror}') from error
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile='ros2', library=f'rsmb_ros {rsmb_ros.__version__}')
        metadata = {'version': rsmb_ros.__version__}
        if config is not None:
            metadata['config'] = to_json(config.nested())
        self._writer.add_metadata(METADATA, metadata)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.finish()
        self._stream.close()
        self._part.replace(self.path)

    def write(self, topic: str, message: Any, log_time_ns: int, latched: bool = False) -> None:
        """
        Write a message made by `BagFactory` or read from a ROS 2 bag.

        Parameters
        ----------
        topic : str
        message : object of the rosbags type store
        log_time_ns : int
        latched : bool
            Played back transient_local, so that late subscribers receive it too.

        """
        self.write_cdr(topic, message.__msgtype__, serialised(message), log_time_ns, latched)

    def write_cdr(
        self, topic: str, kind: str, data: bytes, log_time_ns: int, latched: bool = False
    ) -> None:
        """Write a message of type `kind` ('std_msgs/msg/String') that is serialised already."""
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(
                topic, 'cdr', self._schema(kind), _channel_metadata(latched)
            )
            self._sequence[topic] = 0
        self._writer.add_message(
            self._channels[topic],
            log_time=log_time_ns,
            publish_time=log_time_ns,
            data=data,
            sequence=self._sequence[topic],
        )
        self._sequence[topic] += 1

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text, _ = _TYPES.generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, 'ros2msg', text.encode())
        return self._schemas[kind]


def serialised(message: Any) -> bytes:
    """Return a message of `BagFactory`, or one read from a bag, as CDR: what travels over ROS 2."""
    return bytes(_TYPES.serialize_cdr(message, message.__msgtype__))


class BagFactory:
    """The `MessageFactory` of recordings; also makes what recordings are made of."""

    def image(self, header: Any, array: np.ndarray) -> Any:
        """Return an Image."""
        return self._new('sensor_msgs/msg/Image', header=header, **image_fields(array)._asdict())

    def text(self, text: str) -> Any:
        """Return a String."""
        return self._new('std_msgs/msg/String', data=text)

    def rows(self, array: np.ndarray, labels: tuple[str, ...]) -> Any:
        """Return a Float32MultiArray."""
        fields = rows_fields(array, labels)
        dimensions = [
            self._new('std_msgs/msg/MultiArrayDimension', label=label, size=size, stride=stride)
            for label, size, stride in fields.dimensions
        ]
        layout = self._new('std_msgs/msg/MultiArrayLayout', dim=dimensions, data_offset=0)
        return self._new('std_msgs/msg/Float32MultiArray', layout=layout, data=fields.data)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Return a Header."""
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        stamp = self._new('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return self._new('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)

    def compressed(self, header: Any, data: bytes, text: str) -> Any:
        """Return a CompressedImage of JPEG or PNG bytes; `text` is its format field."""
        stored = np.frombuffer(data, np.uint8)
        return self._new('sensor_msgs/msg/CompressedImage', header=header, format=text, data=stored)

    def camera_info(self, header: Any, shape: tuple[int, int], focal_px: float) -> Any:
        """Return a CameraInfo of a pinhole with its principal point at the image centre."""
        rows, cols = shape
        k = [focal_px, 0, (cols - 1) / 2, 0, focal_px, (rows - 1) / 2, 0, 0, 1]
        p = [*k[:3], 0, *k[3:6], 0, *k[6:], 0]
        region = self._new(
            'sensor_msgs/msg/RegionOfInterest',
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        return self._new(
            'sensor_msgs/msg/CameraInfo',
            header=header,
            height=rows,
            width=cols,
            distortion_model='plumb_bob',
            d=np.zeros(5),
            k=np.array(k, np.float64),
            r=np.eye(3).reshape(-1),
            p=np.array(p, np.float64),
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    @staticmethod
    def _new(kind: str, **fields: Any) -> Any:
        return _TYPES.types[kind](**fields)


def _channel_metadata(latched: bool) -> dict[str, str]:
    depth, durability = (1, 'transient_local') if latched else (10, 'volatile')
    return {'offered_qos_profiles': _QOS.format(depth=depth, durability=durability)}
