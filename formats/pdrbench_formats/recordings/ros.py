"""Bags of ROS 1 and ROS 2, and MCAP files.

App: rosbag, rosbag2, Foxglove; needs the extra `formats`.
Files: `.bag`; the folder of a ROS 2 bag with `metadata.yaml`; `.db3`; `.mcap` with messages of ROS 1, in CDR or JSON.
Sensors: `sensor_msgs/Imu` as accel, gyro, rotation; `MagneticField` as mag; `FluidPressure` as baro; poses as the
reference, odometry as a reference that is not scored.
Units: m/s² with gravity, rad/s, T, Pa, m.
Frame: of `frame_id`, as the unit is mounted: often x forward, y left; the reference is that of its topic.
Clock: `header.stamp`, which differs from the time in the bag; the latter where no message has a stamp.
Traps: the attitude may be missing (covariance -1) or be the identity from end to end; clocks of simulators begin at 0;
several units in one bag, of which the one with most messages is read; drivers write gauss or µT where tesla is due.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import refuse_compressed
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, places, seconds, unit_quaternions
from pdrbench_formats.recordings.attitude import device_to_building
from pdrbench_formats.recordings.ros_messages import IMU, MCAP, ODOMETRY, POSES, Topic, kind_of, read_mcap

BAG1: Final = b"#ROSBAG V2.0"
SQLITE: Final = b"SQLite format 3\0"
METADATA: Final = "metadata.yaml"
MAX_METADATA_BYTES: Final = 1 << 20
MAX_MESSAGES: Final = 20_000_000
_MAG, _BARO = "MagneticField", "FluidPressure"
_TESLA: Final = (1e-6, 1e-3)  # median length of a field that is in tesla
_GAUSS: Final = (0.05, 5.0)


@dataclass(frozen=True, slots=True)
class _Table:
    """The messages of one topic.

    Attributes:
        kind: Key of `KINDS`.
        stamp_ns: (T,) of the headers, or of the bag where no header has any.
        values: (T, C) as `Topic.values` gives them.
    """

    kind: str
    stamp_ns: NDArray[np.int64]
    values: FloatArray


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads the inertial unit of a bag.

    Raises:
        RecordingError: Names file, topic and remedy.
    """
    path, tally = Path(path), Tally()
    refuse_compressed(path)
    files = _mcap_files(path)
    topics = read_mcap(files, tally) if files else _of_bag(path, tally)
    tables = {name: _table(name, topics.pop(name), path, tally) for name in list(topics)}
    chosen = {kind: table for kind in (IMU, _MAG, _BARO) if (table := _choose(kind, tables, tally)) is not None}
    if not chosen:
        raise RecordingError(
            f"{path}: no topic of sensor_msgs/Imu among {', '.join(sorted(tally.skipped)) or 'its topics'}; "
            f"record the topic of the inertial unit"
        )
    origin_ns = min(int(tables[name].stamp_ns.min()) for name in chosen.values())
    streams: dict[str, FloatArray] = {}
    for kind, name in chosen.items():
        values = tables[name].values
        t_s = seconds(tables[name].stamp_ns, origin_ns)
        if kind == IMU:
            streams["accel"] = np.column_stack([t_s, values[:, 3:6]])
            streams["gyro"] = np.column_stack([t_s, values[:, 0:3]])
            q = _attitude(values, t_s, tally)
            if q is not None:
                streams["rotation"] = np.column_stack([t_s, q])
        elif kind == _MAG:
            streams["mag"] = np.column_stack([t_s, values * _to_microtesla(values, name, tally)])
        else:
            streams["baro"] = np.column_stack([t_s, values / 100.0])
    start_s = origin_ns * 1e-9
    if start_s < 6e8:
        tally.note("note", "clock", "header.stamp", f"begins at {start_s:.3f} s", "the clock is a simulator's")
    return assemble(
        path,
        streams,
        reference=_reference(tables, origin_ns, tally),
        origin=Origin(start_unix_s=start_s if start_s >= 6e8 else None),
        tally=tally,
        allow_unsorted=tuple(streams),
        strict=strict,
    )


def _table(name: str, topic: Topic, path: Path, tally: Tally) -> _Table:
    stamp_ns, values = topic.values(f"{path}: {name}")
    if not (stamp_ns > 0).any():
        tally.mended[f"{name} by the clock of the bag"] += len(stamp_ns)
        stamp_ns = np.array(topic.bag_ns, dtype=np.int64)
    return _Table(topic.kind, stamp_ns, values)


def _choose(kind: str, tables: dict[str, _Table], tally: Tally) -> str | None:
    """The topic of a kind with most messages."""
    topics = sorted((name for name in tables if tables[name].kind == kind), key=lambda name: -len(tables[name].values))
    if len(topics) > 1:
        seen = f"{len(topics)} topics hold sensor_msgs/{kind}: {', '.join(topics)}"
        tally.found("two-devices, topics", topics[0], seen)
        tally.skipped.update({topic: len(tables[topic].values) for topic in topics[1:]})
    return topics[0] if topics else None


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


def _reference(tables: dict[str, _Table], origin_ns: int, tally: Tally) -> Trajectory | None:
    order = (*POSES, ODOMETRY)
    topics = [name for name in tables if tables[name].kind in order]
    if not topics:
        return None
    topic = min(topics, key=lambda name: (order.index(tables[name].kind), -len(tables[name].values)))
    tally.skipped.update({other: len(tables[other].values) for other in topics if other != topic})
    is_odometry = tables[topic].kind == ODOMETRY
    if is_odometry:
        tally.note("note", "reference", topic, "odometry is no truth", "it is drawn and not scored")
    xyz = tables[topic].values
    t_s = seconds(tables[topic].stamp_ns, origin_ns)
    return places(t_s, xyz[:, :2], surveyed=not is_odometry, z_m=xyz[:, 2], tally=tally)


def _mcap_files(path: Path) -> list[Path]:
    """The MCAP file, or those of a folder that holds no other bag; [] of any other."""
    container = open_container(path)
    if path.is_file():
        return [path] if container.read(path.name, len(MCAP)) == MCAP else []
    names = container.names(".mcap")
    if not (path / METADATA).is_file() and len(names) != 1:  # several bags, or none
        return []
    others = [name for end in (".bag", ".db3", ".zstd") for name in container.names(end)]
    return [] if others else [path / (container.prefix + name) for name in sorted(names)]


def _of_bag(path: Path, tally: Tally) -> dict[str, Topic]:
    """Messages by topic of what rosbags reads."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise RecordingError(f"{path}: bags need rosbags: pip install pdrbench[formats]") from error
    place, topics = _bag(path), dict[str, Topic]()
    try:
        with AnyReader([place], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            wanted = [connection for connection in bag.connections if kind_of(connection.msgtype)]
            for connection in bag.connections:
                tally.skipped[connection.topic] += 0 if connection in wanted else connection.msgcount
            messages = bag.messages(connections=wanted) if wanted else ()
            encoding = "cdr" if bag.is2 else "ros1"
            topics = {connection.topic: Topic(kind_of(connection.msgtype), encoding) for connection in wanted}
            for count, (connection, bag_ns, raw) in enumerate(messages):
                if count >= MAX_MESSAGES:
                    raise RecordingError(f"{path}: more than {MAX_MESSAGES} messages; split the bag")
                topics[connection.topic].bag_ns.append(bag_ns)
                topics[connection.topic].messages.append(bytes(raw))
    except RecordingError:
        raise
    except Exception as error:  # the parsers of bags raise whatever a damaged file leads them to
        raise RecordingError(
            f"{path}: the bag cannot be read ({type(error).__name__}: {str(error)[:200]}); "
            f"repair it with `rosbag reindex` or `ros2 bag reindex`, or copy it again"
        ) from error
    return topics


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
