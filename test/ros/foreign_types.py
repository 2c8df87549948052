"""Messages of ROS for cyclonedds, under the names that ROS gives them on the wire."""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, sequence, uint8, uint32


@dataclass
class Time(IdlStruct, typename='builtin_interfaces::msg::dds_::Time_'):
    """builtin_interfaces/Time."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename='std_msgs::msg::dds_::Header_'):
    """std_msgs/Header."""

    stamp: Time
    frame_id: str


@dataclass
class Image(IdlStruct, typename='sensor_msgs::msg::dds_::Image_'):
    """sensor_msgs/Image."""

    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class String(IdlStruct, typename='std_msgs::msg::dds_::String_'):
    """std_msgs/String."""

    data: str


BY_NAME = {'sensor_msgs/msg/Image': Image, 'std_msgs/msg/String': String}


def image(fields):
    """Return an Image from nested dictionaries."""
    header = fields['header']
    rest = {name: value for name, value in fields.items() if name != 'header'}
    return Image(header=Header(Time(**header['stamp']), header['frame_id']), **rest)
