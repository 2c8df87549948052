"""Messages of rclpy."""

from __future__ import annotations

from array import array as byte_array

import numpy as np
from sensor_msgs.msg import Image
from std_msgs.msg import (
    Float32MultiArray,
    Header,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)

from rsmb_ros.messages.factory import image_fields, rows_fields


class RclpyFactory:
    """The `MessageFactory` of the node."""

    def image(self, header: Header, array: np.ndarray) -> Image:
        """Return an Image."""
        fields = image_fields(array)._asdict()
        return Image(header=header, **{**fields, 'data': _as_array('B', fields['data'])})

    def text(self, text: str) -> String:
        """Return a String."""
        return String(data=text)

    def rows(self, array: np.ndarray, labels: tuple[str, ...]) -> Float32MultiArray:
        """Return a Float32MultiArray."""
        fields = rows_fields(array, labels)
        dimensions = [
            MultiArrayDimension(label=label, size=size, stride=stride)
            for label, size, stride in fields.dimensions
        ]
        return Float32MultiArray(
            layout=MultiArrayLayout(dim=dimensions), data=_as_array('f', fields.data)
        )


def _as_array(typecode: str, values: np.ndarray) -> byte_array:
    """Copy into the one container that rclpy takes without a loop over the elements."""
    filled = byte_array(typecode)
    filled.frombytes(values.data.cast('B'))
    return filled
