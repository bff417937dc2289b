"""Bags of ROS 1 and ROS 2, and MCAP files.

App: rosbag, rosbag2, Foxglove; needs the extra `formats`.
Files: `.bag`; the folder of a ROS 2 bag with `metadata.yaml`; `.db3`; `.mcap` with messages in CDR or JSON.
Sensors: `sensor_msgs/Imu` as accel, gyro, rotation; `MagneticField` as mag; `FluidPressure` as baro; poses as the
reference, odometry as a reference that is not scored.
Units: m/s² with gravity, rad/s, T, Pa, m.
Frame: of `frame_id`, as the unit is mounted: often x forward, y left; the reference is that of its topic.
Clock: `header.stamp`, which differs from the time in the bag; the latter where no message has a stamp.
Traps: the attitude may be missing (covariance -1) or be the identity from end to end; clocks of simulators begin at 0;
several units in one bag, of which the one with most messages is read; drivers write gauss or µT where tesla is due.
"""

from __future__ import annotations

import json
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, places, seconds, unit_quaternions
from pdrbench_formats.recordings.findings import device_to_building

BAG1: Final = b"#ROSBAG V2.0"
MCAP: Final = b"\x89MCAP0\r\n"
SQLITE: Final = b"SQLite format 3\0"
METADATA: Final = "metadata.yaml"
MAX_METADATA_BYTES: Final = 1 << 20
MAX_MESSAGES: Final = 20_000_000
_IMU, _MAG, _BARO = "Imu", "MagneticField", "FluidPressure"
_POSES: Final = ("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")
_ODOMETRY: Final = "Odometry"
_READ: Final = (_IMU, _MAG, _BARO, *_POSES, _ODOMETRY)
_IMU_BYTES, _HEADER_BYTES = 37 * 8, 16
_TESLA: Final = (1e-6, 1e-3)  # median length of a field that is in tesla
_GAUSS: Final = (0.05, 5.0)

Rows = list[tuple[float, ...]]


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads the inertial unit of a bag.

    Raises:
        RecordingError: Names file, topic and remedy.
    """
    path, tally = Path(path), Tally()
    messages = _json_messages if _is_json_mcap(path) else _ros_messages
    stamps: dict[str, list[tuple[int, int]]] = defaultdict(list)
    rows: dict[str, Rows] = defaultdict(list)
    kinds: dict[str, str] = {}
    for topic, kind, stamp_ns, bag_ns, numbers in messages(path, tally):
        stamps[topic].append((stamp_ns, bag_ns))
        rows[topic].append(numbers)
        kinds[topic] = kind
    chosen = {kind: _choose(kind, rows, kinds, tally) for kind in (_IMU, _MAG, _BARO)}
    if chosen[_IMU] is None and chosen[_MAG] is None and chosen[_BARO] is None:
        raise RecordingError(
            f"{path}: no topic of sensor_msgs/Imu among {', '.join(sorted(tally.skipped)) or 'its topics'}; "
            f"record the topic of the inertial unit"
        )
    clock = {topic: _times(np.array(pairs, dtype=np.int64), topic, tally) for topic, pairs in stamps.items()}
    used = [topic for topic in chosen.values() if topic is not None]
    origin_ns = min(int(clock[topic].min()) for topic in used)
    streams: dict[str, FloatArray] = {}
    if (imu := chosen[_IMU]) is not None:
        t_s, values = seconds(clock[imu], origin_ns), np.array(rows[imu], dtype=np.float64)
        streams["accel"] = np.column_stack([t_s, values[:, 3:6]])
        streams["gyro"] = np.column_stack([t_s, values[:, 0:3]])
        q = _attitude(values, t_s, tally)
        if q is not None:
            streams["rotation"] = np.column_stack([t_s, q])
    if (compass := chosen[_MAG]) is not None:
        field = np.array(rows[compass], dtype=np.float64)
        t_s = seconds(clock[compass], origin_ns)
        streams["mag"] = np.column_stack([t_s, field * _to_microtesla(field, compass, tally)])
    if (baro := chosen[_BARO]) is not None:
        pressure = np.array(rows[baro], dtype=np.float64) / 100.0
        streams["baro"] = np.column_stack([seconds(clock[baro], origin_ns), pressure])
    start_s = origin_ns * 1e-9
    if start_s < 6e8:
        tally.note("note", "clock", "header.stamp", f"begins at {start_s:.3f} s", "the clock is a simulator's")
    return assemble(
        path,
        streams,
        reference=_reference(rows, kinds, clock, origin_ns, tally),
        origin=Origin(start_unix_s=start_s if start_s >= 6e8 else None),
        tally=tally,
        allow_unsorted=tuple(streams),
        strict=strict,
    )


def _stamp_ns(m: Any) -> int:
    """Nanoseconds in the header of a message; 0 where it has none."""
    stamp = getattr(getattr(m, "header", None), "stamp", None)
    if stamp is None:
        return 0
    return int(stamp.sec) * 10**9 + int(getattr(stamp, "nanosec", 0) or getattr(stamp, "nsec", 0))


def _imu(raw: bytes, *, is_cdr: bool) -> tuple[int, tuple[float, ...]]:
    """Stamp and numbers of a serialised `sensor_msgs/Imu`, which ends in 37 numbers: three covariances among them.

    In ROS 1 a counter stands before the stamp, in CDR four bytes that say how the rest is written.
    """
    order = ">" if is_cdr and not raw[1] & 1 else "<"
    sec, nanosec = struct.unpack_from(f"{order}iI" if is_cdr else "<II", raw, 4)
    n = struct.unpack(f"{order}37d", raw[-_IMU_BYTES:])
    x, y, z, w = n[:4]
    return sec * 10**9 + nanosec, (*n[13:16], *n[25:28], w, x, y, z, n[4], sum(map(abs, n[4:13])))


def _values(kind: str, m: Any) -> tuple[float, ...]:
    """The numbers of a message that are read."""
    if kind == _IMU:
        w, a, q = m.angular_velocity, m.linear_acceleration, m.orientation
        covariance = getattr(m, "orientation_covariance", None)
        known = 0.0 if covariance is None or len(covariance) == 0 else float(covariance[0])
        spread = 0.0 if covariance is None else float(np.abs(covariance).sum())
        return (w.x, w.y, w.z, a.x, a.y, a.z, q.w, q.x, q.y, q.z, known, spread)
    if kind == _MAG:
        return (m.magnetic_field.x, m.magnetic_field.y, m.magnetic_field.z)
    if kind == _BARO:
        return (float(m.fluid_pressure),)
    if kind == "TransformStamped":
        return (m.transform.translation.x, m.transform.translation.y, m.transform.translation.z)
    pose = m.pose if kind == "PoseStamped" else m.pose.pose
    return (pose.position.x, pose.position.y, pose.position.z)


def _choose(kind: str, rows: dict[str, Rows], kinds: dict[str, str], tally: Tally) -> str | None:
    """The topic of a kind with most messages."""
    topics = sorted((topic for topic in rows if kinds[topic] == kind), key=lambda topic: -len(rows[topic]))
    if len(topics) > 1:
        tally.note(
            "warning",
            "two-devices",
            topics[0],
            f"{len(topics)} topics hold sensor_msgs/{kind}: {', '.join(topics)}",
            "the one with most messages is read; keep one topic with `rosbag filter` to choose another",
        )
        tally.skipped.update({topic: len(rows[topic]) for topic in topics[1:]})
    return topics[0] if topics else None


def _times(pairs: np.ndarray[Any, np.dtype[np.int64]], topic: str, tally: Tally) -> np.ndarray[Any, np.dtype[np.int64]]:
    """(T,) nanoseconds of the header, or of the bag where no header has any."""
    if (pairs[:, 0] > 0).any():
        stamped: np.ndarray[Any, np.dtype[np.int64]] = pairs[:, 0]
        return stamped
    tally.mended[f"{topic} by the clock of the bag"] += len(pairs)
    of_bag: np.ndarray[Any, np.dtype[np.int64]] = pairs[:, 1]
    return of_bag


def _attitude(values: FloatArray, t_s: FloatArray, tally: Tally) -> FloatArray | None:
    q, known, spread = values[:, 6:10], values[:, 10], values[:, 11]
    length = np.linalg.norm(q, axis=1)
    is_identity = bool((q == q[0]).all() and (spread == 0.0).all())
    if (known == -1.0).any() or is_identity or not (np.abs(length - 1.0) < 0.05).all():
        tally.skipped["attitude that the unit does not know"] += len(q)
        return None
    upright = device_to_building(t_s, unit_quaternions(q), t_s, values[:, 3:6])
    if upright is None:
        tally.skipped["attitude that does not turn gravity up"] += len(q)
        tally.note("warning", "quaternion", "orientation", "it does not turn gravity up", "it was left out")
    return upright


def _to_microtesla(field: FloatArray, topic: str, tally: Tally) -> float:
    length = float(np.nanmedian(np.linalg.norm(field, axis=1))) if len(field) else 0.0
    if _TESLA[0] <= length <= _TESLA[1]:
        return 1e6
    unit, factor = ("gauss", 100.0) if _GAUSS[0] <= length <= _GAUSS[1] else ("microtesla", 1.0)
    tally.note("warning", "mag-unit", topic, f"the median length is {length:.4g} where tesla is due", f"read as {unit}")
    return factor


def _reference(
    rows: dict[str, Rows], kinds: dict[str, str], clock: dict[str, Any], origin_ns: int, tally: Tally
) -> Trajectory | None:
    topics = [topic for topic in rows if kinds[topic] in (*_POSES, _ODOMETRY)]
    if not topics:
        return None
    topic = min(topics, key=lambda topic: ((*_POSES, _ODOMETRY).index(kinds[topic]), -len(rows[topic])))
    tally.skipped.update({other: len(rows[other]) for other in topics if other != topic})
    is_odometry = kinds[topic] == _ODOMETRY
    if is_odometry:
        tally.note("note", "reference", topic, "odometry is no truth", "it is drawn and not scored")
    xyz = np.array(rows[topic], dtype=np.float64)
    t_s = seconds(clock[topic], origin_ns)
    return places(t_s, xyz[:, :2], surveyed=not is_odometry, z_m=xyz[:, 2], tally=tally)


def _ros_messages(path: Path, tally: Tally) -> Iterator[tuple[str, str, int, int, tuple[float, ...]]]:
    """Topic, kind, nanoseconds of the header and of the bag, and numbers of every message that is read."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RecordingError(f"{path}: bags need rosbags: pip install pdrbench[formats]") from error
    place = _bag(path)
    count = 0
    try:
        with AnyReader([place], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            wanted = []
            for connection in bag.connections:
                package, _, kind = connection.msgtype.replace("/msg/", "/").partition("/")
                if kind in _READ and package in ("sensor_msgs", "nav_msgs", "geometry_msgs"):
                    wanted.append(connection)
                else:
                    tally.skipped[connection.topic] += connection.msgcount
            for connection, bag_ns, raw in bag.messages(connections=wanted) if wanted else ():
                count += 1
                if count > MAX_MESSAGES:
                    raise RecordingError(f"{path}: more than {MAX_MESSAGES} messages; split the bag")
                kind = connection.msgtype.rpartition("/")[2]
                if kind == _IMU and len(raw) > _IMU_BYTES + _HEADER_BYTES:
                    stamp_ns, values = _imu(bytes(raw), is_cdr=bag.is2)  # ten times as fast as the library
                    yield connection.topic, kind, stamp_ns, int(bag_ns), values
                    continue
                message = bag.deserialize(raw, connection.msgtype)
                yield connection.topic, kind, _stamp_ns(message), int(bag_ns), _values(kind, message)
    except RecordingError:
        raise
    except Exception as error:  # the parsers of bags raise whatever a damaged file leads them to
        raise RecordingError(
            f"{path}: the bag cannot be read ({type(error).__name__}: {str(error)[:200]}); "
            f"repair it with `rosbag reindex` or `ros2 bag reindex`, or copy it again"
        ) from error


def _bag(path: Path) -> Path:
    """The path that the library takes: a file, or a folder with metadata."""
    if not path.is_dir():
        return path
    metadata = path / METADATA
    if metadata.is_file():
        if metadata.stat().st_size > MAX_METADATA_BYTES:
            raise RecordingError(f"{metadata}: {metadata.stat().st_size} bytes, expected less; copy the bag again")
        return path
    container = open_container(path)
    bags = [container.prefix + name for end in (".bag", ".mcap", ".db3") for name in container.names(end)]
    if len(bags) != 1:
        raise RecordingError(f"{path}: {len(bags)} bags ({', '.join(bags[:3])}); name one of them")
    return path / bags[0]


def _is_json_mcap(path: Path) -> bool:
    if not path.is_file() or open_container(path).read(path.name, 8) != MCAP:
        return False
    try:
        from mcap.reader import make_reader
    except ImportError as error:
        raise RecordingError(f"{path}: MCAP files need mcap: pip install pdrbench[formats]") from error
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
            encodings = {} if summary is None else {c.message_encoding for c in summary.channels.values()}
    except Exception as error:  # as above
        raise RecordingError(f"{path}: the file is damaged ({error}); repair it with `mcap recover`") from error
    if "ros1" in encodings:
        raise RecordingError(f"{path}: messages of ROS 1 in MCAP; convert it with `rosbags-convert` to a .bag")
    return "json" in encodings


def _json_messages(path: Path, tally: Tally) -> Iterator[tuple[str, str, int, int, tuple[float, ...]]]:
    from mcap.reader import make_reader

    try:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                kind = "" if schema is None else schema.name.rpartition("/")[2].rpartition(".")[2]
                if kind not in _READ or channel.message_encoding != "json":
                    tally.skipped[channel.topic] += 1
                    continue
                content = json.loads(message.data, object_hook=lambda fields: SimpleNamespace(**fields))
                yield channel.topic, kind, _stamp_ns(content), int(message.log_time), _values(kind, content)
    except Exception as error:  # as above
        raise RecordingError(f"{path}: the file is damaged ({error}); repair it with `mcap recover`") from error


def sniff(head: Head) -> bool:
    """True for a bag."""
    if head.path.is_dir():
        if (head.path / METADATA).is_file():
            return b"rosbag2_bagfile_information" in (head.path / METADATA).read_bytes()[:4096]
        return sum(len(head.members(end)) for end in (".bag", ".mcap", ".db3")) == 1 and not head.members(".csv")
    if head.content.startswith(SQLITE):
        return head.path.suffix == ".db3"
    return head.content.startswith((BAG1, MCAP))


READER: Final = Reader(read, sniff, options=("strict",))
