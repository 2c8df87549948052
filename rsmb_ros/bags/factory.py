"""What recordings are made of: messages of the rosbags type store."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsmb_ros.messages.detections import DetectionFields
from rsmb_ros.messages.diagnostics import StatusFields
from rsmb_ros.messages.factory import image_fields, rows_fields

from .typestore import new


class BagFactory:
    """The `MessageFactory` of recordings; also makes what recordings are made of."""

    def image(self, header: Any, array: np.ndarray) -> Any:
        """Return an Image."""
        return new('sensor_msgs/msg/Image', header=header, **image_fields(array)._asdict())

    def text(self, text: str) -> Any:
        """Return a String."""
        return new('std_msgs/msg/String', data=text)

    def rows(self, array: np.ndarray, labels: tuple[str, ...]) -> Any:
        """Return a Float32MultiArray."""
        fields = rows_fields(array, labels)
        dimensions = [
            new('std_msgs/msg/MultiArrayDimension', label=label, size=size, stride=stride)
            for label, size, stride in fields.dimensions
        ]
        layout = new('std_msgs/msg/MultiArrayLayout', dim=dimensions, data_offset=0)
        return new('std_msgs/msg/Float32MultiArray', layout=layout, data=fields.data)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Return a Header."""
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        stamp = new('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return new('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)

    def compressed(self, header: Any, data: bytes, text: str) -> Any:
        """Return a CompressedImage of JPEG or PNG bytes; `text` is its format field."""
        stored = np.frombuffer(data, np.uint8)
        return new('sensor_msgs/msg/CompressedImage', header=header, format=text, data=stored)

    def camera_info(self, header: Any, shape: tuple[int, int], focal_px: float) -> Any:
        """Return a CameraInfo of a pinhole with its principal point at the image centre."""
        rows, cols = shape
        k = [focal_px, 0, (cols - 1) / 2, 0, focal_px, (rows - 1) / 2, 0, 0, 1]
        p = [*k[:3], 0, *k[3:6], 0, *k[6:], 0]
        region = new(
            'sensor_msgs/msg/RegionOfInterest',
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        return new(
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

    def detections(self, header: Any, found: Sequence[DetectionFields]) -> Any:
        """Return a Detection2DArray."""
        detections = [_detection(header, fields) for fields in found]
        return new('vision_msgs/msg/Detection2DArray', header=header, detections=detections)

    def diagnostics(self, header: Any, state: StatusFields) -> Any:
        """Return a DiagnosticArray of one status."""
        values = [
            new('diagnostic_msgs/msg/KeyValue', key=key, value=value)
            for key, value in state.values.items()
        ]
        fields = {**state._asdict(), 'values': values}
        status = new('diagnostic_msgs/msg/DiagnosticStatus', **fields)
        return new('diagnostic_msgs/msg/DiagnosticArray', header=header, status=[status])


def _detection(header: Any, fields: DetectionFields) -> Any:
    position = new('vision_msgs/msg/Point2D', x=fields.center_x, y=fields.center_y)
    box = new(
        'vision_msgs/msg/BoundingBox2D',
        center=new('vision_msgs/msg/Pose2D', position=position, theta=0.0),
        size_x=fields.size_x,
        size_y=fields.size_y,
    )
    what = new(
        'vision_msgs/msg/ObjectHypothesisWithPose',
        hypothesis=new(
            'vision_msgs/msg/ObjectHypothesis', class_id=fields.class_id, score=fields.score
        ),
        pose=_no_pose(),
    )
    return new('vision_msgs/msg/Detection2D', header=header, results=[what], bbox=box, id=fields.id)


def _no_pose() -> Any:
    """Return the pose that a new PoseWithCovariance has."""
    pose = new(
        'geometry_msgs/msg/Pose',
        position=new('geometry_msgs/msg/Point', x=0.0, y=0.0, z=0.0),
        orientation=new('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0),
    )
    return new('geometry_msgs/msg/PoseWithCovariance', pose=pose, covariance=np.zeros(36))
