"""Messages of ROS as tables: what stands in the bytes of `Imu`, `MagneticField`, `FluidPressure` and poses.

Each kind that is read begins with a header and ends in a fixed count of numbers, in ROS 1 as in CDR (OMG DDSI-RTPS 2.2,
10.2): the messages of a topic are cut from their ends all at once. Texts between them, such as the frame, are not read.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray

IMU: Final = "Imu"
POSES: Final = ("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")
ODOMETRY: Final = "Odometry"
KINDS: Final[Mapping[str, int]] = {  # numbers at the end of a message
    IMU: 37,
    "MagneticField": 12,
    "FluidPressure": 2,
    "PoseStamped": 7,
    "PoseWithCovarianceStamped": 43,
    "TransformStamped": 7,
    ODOMETRY: 85,
}
MAX_MESSAGE_BYTES: Final = 1 << 16
_PACKAGES: Final = ("sensor_msgs", "nav_msgs", "geometry_msgs")
_STAMP_AT: Final = 4  # behind the counter of ROS 1, or the four bytes in CDR that say how the rest is written
_HEADER_BYTES: Final = 16  # those, two numbers of the stamp, and the length of the frame's name
_IS_LITTLE: Final = 1  # bit of the second byte in CDR


def kind_of(message_type: str) -> str:
    """The kind of a type such as `sensor_msgs/msg/Imu`; "" of one that is not read."""
    package, _, kind = message_type.replace("/msg/", "/").partition("/")
    return kind if kind in KINDS and package in _PACKAGES else ""


@dataclass(slots=True)
class Topic:
    """The messages of a topic as they come from a bag.

    Attributes:
        kind: Key of `KINDS`.
        encoding: "ros1", "cdr" or "json".
        bag_ns: Time of each in the bag.
        messages: Content of each.
    """

    kind: str
    encoding: str
    bag_ns: list[int] = field(default_factory=list)
    messages: list[bytes] = field(default_factory=list)

    def values(self, label: str) -> tuple[NDArray[np.int64], FloatArray]:
        """Nanoseconds in the headers (T,), 0 where there are none, and numbers (T, C).

        The numbers of an `Imu` are angular velocity, acceleration, attitude w, x, y, z, the first number of the
        attitude's covariance and the sum of its sizes; of the others three of field or position, or the pressure.
        The messages are given up.

        Raises:
            RecordingError: A message is too short, or no message of that kind.
        """
        read = _from_json if self.encoding == "json" else _from_bytes
        stamp_ns, values = read(self, label)
        self.messages.clear()
        return stamp_ns, values


def _from_bytes(topic: Topic, label: str) -> tuple[NDArray[np.int64], FloatArray]:
    count = KINDS[topic.kind]
    sizes = np.fromiter(map(len, topic.messages), np.int64, len(topic.messages))
    least = 8 * count + _HEADER_BYTES
    wrong = np.flatnonzero((sizes < least) | (sizes > MAX_MESSAGE_BYTES))
    if len(wrong):
        raise RecordingError(
            f"{label}: message {wrong[0] + 1} has {sizes[wrong[0]]} bytes, expected {least} or some more of a "
            f"{topic.kind}; record the topic again"
        )
    stamp_ns = np.zeros(len(sizes), np.int64)
    values = np.zeros((len(sizes), _select(topic.kind, np.zeros((1, count))).shape[1]))
    order = np.argsort(sizes, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1) if len(order) else ():
        block = np.frombuffer(b"".join([topic.messages[row] for row in rows.tolist()]), np.uint8)
        block = block.reshape(len(rows), -1)
        is_little = block[:, 1] & _IS_LITTLE if topic.encoding == "cdr" else np.ones(len(rows), np.uint8)
        for sign, at in (("<", np.flatnonzero(is_little)), (">", np.flatnonzero(is_little == 0))):
            if len(at):
                whole = block if len(at) == len(block) else block[at]
                stamp = np.ascontiguousarray(whole[:, _STAMP_AT : _STAMP_AT + 8]).view(f"{sign}u4").astype(np.int64)
                stamp_ns[rows[at]] = stamp[:, 0] * 10**9 + stamp[:, 1]
                numbers = np.ascontiguousarray(whole[:, -8 * count :]).view(f"{sign}f8")
                values[rows[at]] = _select(topic.kind, numbers)
    return stamp_ns, values


def _select(kind: str, numbers: FloatArray) -> FloatArray:
    """(T, C) of all numbers (T, N) at the ends of messages."""
    if kind == "FluidPressure":
        return numbers[:, :1]
    if kind != IMU:
        return numbers[:, :3]
    spread = np.abs(numbers[:, 4:13]).sum(axis=1)
    return np.column_stack([numbers[:, 13:16], numbers[:, 25:28], numbers[:, [3, 0, 1, 2]], numbers[:, 4], spread])


_XYZ: Final = ("x", "y", "z")
_JSON: Final[Mapping[str, tuple[str, ...]]] = {  # members of a message in JSON, down to the numbers
    IMU: (
        *(f"angular_velocity.{axis}" for axis in _XYZ),
        *(f"linear_acceleration.{axis}" for axis in _XYZ),
        *(f"orientation.{axis}" for axis in ("w", *_XYZ)),
    ),
    "MagneticField": tuple(f"magnetic_field.{axis}" for axis in _XYZ),
    "FluidPressure": ("fluid_pressure",),
    "PoseStamped": tuple(f"pose.position.{axis}" for axis in _XYZ),
    "PoseWithCovarianceStamped": tuple(f"pose.pose.position.{axis}" for axis in _XYZ),
    "TransformStamped": tuple(f"transform.translation.{axis}" for axis in _XYZ),
    ODOMETRY: tuple(f"pose.pose.position.{axis}" for axis in _XYZ),
}


def _from_json(topic: Topic, label: str) -> tuple[NDArray[np.int64], FloatArray]:
    paths = [tuple(path.split(".")) for path in _JSON[topic.kind]]
    stamps: list[int] = []
    rows: list[list[float | None]] = []
    try:
        for content in topic.messages:
            message = msgspec.json.decode(content)
            stamp = message.get("header", {}).get("stamp", {})
            stamps.append(int(stamp.get("sec", 0)) * 10**9 + int(stamp.get("nanosec", 0) or stamp.get("nsec", 0)))
            row = [functools.reduce(operator.getitem, path, message) for path in paths]
            if topic.kind == IMU:
                covariance = message.get("orientation_covariance") or [0.0]
                row += [covariance[0], sum(abs(value or 0.0) for value in covariance)]
            rows.append(row)
        return np.array(stamps, dtype=np.int64), np.array(rows, dtype=np.float64)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, *_ODD) as error:
        raise RecordingError(f"{label}: message {len(rows) + 1}: no {topic.kind}: {error}; record it again") from error


_ODD: Final = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError)  # of other members
