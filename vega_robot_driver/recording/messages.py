# SPDX-License-Identifier: Apache-2.0
"""Standard ROS 2 messages in the bytes of the wire (CDR), and what they look like.

Written by hand, so that a recording needs no ROS: the fields are those of the interface
packages of ROS 2, and readers find their description in the file.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

_TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = (
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + "=" * 80 + "\n"
) + _TIME
_LINE = "=" * 80 + "\n"

#: Descriptions by the name of the type, in the format `ros2msg`.
SCHEMAS = {
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n" + _LINE + _HEADER
    ),
    "sensor_msgs/msg/FluidPressure": (
        "std_msgs/Header header\nfloat64 fluid_pressure\nfloat64 variance\n" + _LINE + _HEADER
    ),
    "std_msgs/msg/Bool": "bool data\n",
    "std_msgs/msg/Float64": "float64 data\n",
    "rcl_interfaces/msg/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
        "string function\nuint32 line\n" + _LINE + _TIME
    ),
}
#: Levels of a log message.
INFO, WARN, ERROR = 20, 30, 40


class _Bytes:
    """CDR, little endian: each number aligned to its size."""

    def __init__(self) -> None:
        self._data = bytearray()

    def put(self, form: str, *values: float) -> _Bytes:
        """Append numbers of one format."""
        size = struct.calcsize(form)
        self._data += bytes(-len(self._data) % size)
        self._data += struct.pack(f"<{len(values)}{form}", *values)
        return self

    def text(self, value: str) -> _Bytes:
        """Append a string."""
        data = value.encode()
        self.put("I", len(data) + 1)
        self._data += data + b"\0"
        return self

    def numbers(self, values: Sequence[float]) -> _Bytes:
        """Append a sequence of float64."""
        self.put("I", len(values))
        return self.put("d", *values) if len(values) else self

    def time(self, stamp_ns: int) -> _Bytes:
        """Append a time."""
        return self.put("i", stamp_ns // 10**9).put("I", stamp_ns % 10**9)

    def done(self) -> bytes:
        """The message, with the header that tells the encoding."""
        return b"\x00\x01\x00\x00" + bytes(self._data)


def joint_state(stamp_ns: int, names: Sequence[str], positions: Sequence[float]) -> bytes:
    """sensor_msgs/JointState of positions [m, rad]."""
    message = _Bytes().time(stamp_ns).text("").put("I", len(names))
    for name in names:
        message.text(name)
    return message.numbers(positions).numbers(()).numbers(()).done()


def pressure(stamp_ns: int, pascal: float) -> bytes:
    """sensor_msgs/FluidPressure [Pa]."""
    return _Bytes().time(stamp_ns).text("dispenser").put("d", pascal, 0.0).done()


def boolean(value: bool) -> bytes:
    """std_msgs/Bool."""
    return _Bytes().put("B", value).done()


def number(value: float) -> bytes:
    """std_msgs/Float64."""
    return _Bytes().put("d", value).done()


def log(stamp_ns: int, level: int, text: str) -> bytes:
    """rcl_interfaces/Log."""
    message = _Bytes().time(stamp_ns).put("B", level)
    return message.text("robot_driver").text(text).text("").text("").put("I", 0).done()
