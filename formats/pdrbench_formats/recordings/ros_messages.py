"""Messages of ROS as tables: what stands in the bytes of `Imu`, `MagneticField`, `FluidPressure` and poses.

Each kind that is read begins with a header and ends in a fixed count of numbers, in ROS 1 as in CDR (OMG DDSI-RTPS 2.2,
10.2): the messages of a topic are cut from their ends all at once. Texts between them, such as the frame, are not read.

MCAP files (mcap.dev/spec) hold records one after the other, most of them inside compressed chunks.
"""

from __future__ import annotations

import functools
import mmap
import operator
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_formats.recordings.assemble import Tally

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
MCAP: Final = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES: Final = 1 << 28  # unpacked; writers begin a new chunk after some megabytes
MAX_BYTES: Final = 8 << 30  # of messages that are kept
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_OPCODE_AND_LENGTH: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, counter, time of the bag, time of the sender
_CHUNK_HEAD: Final = struct.Struct("<QQQI")  # first and last time, unpacked size, check sum
_ENCODINGS: Final = ("cdr", "ros1", "json")


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


def read_mcap(paths: Sequence[Path], tally: Tally) -> dict[str, Topic]:
    """The messages of the kinds that are read, by topic.

    Args:
        paths: One file, or the parts of a bag in order.
        tally: Counts messages of other topics; notes where a file is cut.

    Raises:
        RecordingError: A file is damaged, or a chunk unpacks to more than a recording holds.
    """
    topics: dict[str, Topic] = {}
    for path in paths:
        try:
            with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _File(path, topics, tally).read(content, len(MCAP), is_chunk=False)
        except (OSError, ValueError, struct.error) as error:
            raise RecordingError(f"{path}: the file is damaged ({error}); repair it with `mcap recover`") from error
    return topics


class _File:
    """What one file says on its channels."""

    def __init__(self, path: Path, topics: dict[str, Topic], tally: Tally) -> None:
        self.path, self.topics, self.tally = path, topics, tally
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, tuple[str, Topic | None]] = {}
        self.num_bytes = 0

    def read(self, content: mmap.mmap | bytes, place: int, *, is_chunk: bool) -> None:
        """Adds the messages of the file, or of a chunk."""
        size = len(content)
        while place + _OPCODE_AND_LENGTH.size <= size:
            opcode, length = _OPCODE_AND_LENGTH.unpack_from(content, place)
            begin, place = place + _OPCODE_AND_LENGTH.size, place + _OPCODE_AND_LENGTH.size + length
            if place > size:
                break
            if opcode == _MESSAGE:
                channel, _, bag_ns, _ = _MESSAGE_HEAD.unpack_from(content, begin)
                name, topic = self.channels.get(channel, ("a channel that is not declared", None))
                if topic is None:
                    self.tally.skipped[name] += 1
                    continue
                message = content[begin + _MESSAGE_HEAD.size : place]
                topic.bag_ns.append(min(bag_ns, 2**63 - 1))
                topic.messages.append(message)
                self.num_bytes += len(message)
                if self.num_bytes > MAX_BYTES or len(message) > MAX_MESSAGE_BYTES:
                    raise RecordingError(
                        f"{self.path}: {name}: {len(message)} bytes in a message, {self.num_bytes} in all; "
                        f"that is no inertial unit: split the bag, or leave the topic out"
                    )
            elif opcode == _CHUNK and not is_chunk:
                self.read(self._unpacked(content[begin:place]), 0, is_chunk=True)
            elif opcode == _SCHEMA:
                (key,), (schema_name,) = _fields(content[begin:place], "H", 1)
                self.schemas[key] = schema_name
            elif opcode == _CHANNEL:
                (key, schema), (topic_name, encoding) = _fields(content[begin:place], "HH", 2)
                self._declare(key, self.schemas.get(schema, ""), topic_name, encoding)
            elif opcode == _DATA_END:
                return
        if not is_chunk or place > size:
            seen = "the file ends within its data: the recorder was stopped, or it is not copied whole"
            self.tally.found("cut", self.path.name, seen)

    def _declare(self, key: int, message_type: str, name: str, encoding: str) -> None:
        kind = kind_of(message_type)
        if encoding == "json":
            kind = message_type.replace(".", "/").rpartition("/")[2]
        topic = None
        if kind in KINDS and encoding in _ENCODINGS:
            topic = self.topics.setdefault(name, Topic(kind, encoding))
            if (topic.kind, topic.encoding) != (kind, encoding):
                topic = None
        self.channels[key] = name, topic

    def _unpacked(self, chunk: bytes) -> bytes:
        *_, size, _ = _CHUNK_HEAD.unpack_from(chunk)
        (length,) = struct.unpack_from("<I", chunk, _CHUNK_HEAD.size)
        begin = _CHUNK_HEAD.size + 4 + length
        compression, data = chunk[_CHUNK_HEAD.size + 4 : begin], chunk[begin + 8 :]
        if size > MAX_CHUNK_BYTES:
            raise RecordingError(f"{self.path}: a chunk of {size} bytes; that is no recording: do not open it")
        if compression not in _DECOMPRESS:
            raise RecordingError(f"{self.path}: compressed by {compression!r}; convert it with `mcap compress`")
        try:
            return _DECOMPRESS[compression](data, size)
        except ImportError as error:
            raise RecordingError(f"{self.path}: needs {error.name}: pip install pdrbench[formats]") from error


def _fields(record: bytes, keys: str, num_texts: int) -> tuple[tuple[int, ...], list[str]]:
    """Whole numbers and texts at the beginning of a record."""
    place, texts = struct.calcsize(f"<{keys}"), []
    for _ in range(num_texts):
        (length,) = struct.unpack_from("<I", record, place)
        texts.append(record[place + 4 : place + 4 + length].decode())
        place += 4 + length
    return struct.unpack_from(f"<{keys}", record), texts


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    try:
        return zstandard.ZstdDecompressor().stream_reader(data).read(size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    except RuntimeError as error:
        raise ValueError(str(error)) from error


_DECOMPRESS: Final[Mapping[bytes, Callable[[bytes, int], bytes]]] = {
    b"": lambda data, size: data,
    b"zstd": _zstd,
    b"lz4": _lz4,
}
