"""One walk of a phone whose motion is known, written as each app, device and data set writes it.

The tests and the fuzzer of the readers take their files from here. Nothing of it was recorded.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from pdrbench.geometry import FloatArray

Rows = Mapping[str, FloatArray]
Files = dict[str, bytes]

GRAVITY_MPS2: Final = 9.80665
RATE_HZ: Final = 100.0
START_NS: Final = 1_700_000_000_000_000_000  # 14 November 2023
XYZ: Final = ("x", "y", "z")
ADDRESS: Final = "02:00:00:00:00:01"  # of the one access point


def make_walk(duration_s: float = 30.0) -> dict[str, FloatArray]:
    """Rows by sensor at 100 Hz: a phone in a hand that tilts by half a radian and turns, with the shaking of steps.

    Returns:
        accel, gyro, mag, rotation and baro as in `pdrbench.sensors`, and gravity, (T, 4) in m/s^2.
    """
    t_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    angles = np.column_stack([0.3 * t_s, 0.7 + 0.5 * np.sin(0.9 * t_s), 0.4 * np.sin(1.3 * t_s)])
    turn = Rotation.from_euler("ZXY", angles)  # device to building
    step = turn[:-1].inv() * turn[1:]
    gyro = np.vstack([step.as_rotvec() * RATE_HZ, np.zeros(3)])
    gyro[-1] = gyro[-2]
    shake = 2.0 * np.sin(2 * np.pi * 1.9 * t_s)[:, None] * [0.3, 0.2, 1.0]
    accel = turn.apply(shake + np.array([0.0, 0.0, GRAVITY_MPS2]), inverse=True)
    mag = turn.apply(np.tile([0.0, 22.0, -42.0], (len(t_s), 1)), inverse=True)
    q = turn.as_quat()[:, [3, 0, 1, 2]]
    gravity = turn.apply(np.tile([0.0, 0.0, GRAVITY_MPS2], (len(t_s), 1)), inverse=True)
    return {
        "accel": np.column_stack([t_s, accel]),
        "gyro": np.column_stack([t_s, gyro]),
        "mag": np.column_stack([t_s, mag]),
        "rotation": np.column_stack([t_s, q]),
        "baro": np.column_stack([t_s, 1000.0 + 0.1 * np.sin(t_s)]),
        "gravity": np.column_stack([t_s, gravity]),
    }


def lines_of(table: FloatArray, separator: str = ",", form: str = "%.9g") -> list[str]:
    """Each row of a table (T, C) as a line of text."""
    row_form = separator.join([form] * table.shape[1])
    return [row_form % tuple(row) for row in table.tolist()]


def text_of(header: str, table: FloatArray, separator: str = ",", form: str = "%.9g") -> bytes:
    """A table with a header, or without one where that is empty."""
    return "\n".join([*([header] if header else []), *lines_of(table, separator, form), ""]).encode()


def zip_of(path: Path, files: Mapping[str, bytes]) -> Path:
    """Writes an archive."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def folder_of(path: Path, files: Mapping[str, bytes]) -> Path:
    """Writes files into a folder."""
    for name, content in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(content)
    return path


def _table_of(walk: Rows, *sensors: str) -> FloatArray:
    return np.column_stack([walk["accel"][:, 0], *(walk[name][:, 1:] for name in sensors)])


def _names(begin: str, unit: str = "", axes: str = "XYZ") -> str:
    return ",".join(f"{begin}{axis}{unit}" for axis in axes)


def _write(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def _stamp_ns(t_s: float) -> int:
    return START_NS + round(t_s * 1e9)


def getsensordata(folder: Path, walk: Rows, *, comma: bool = False, old: bool = False, scans: bool = False) -> Path:
    """A log of GetSensorData, of 2016 where `old`, with one access point, one beacon and two landmarks.

    With `scans`, sixteen access points are seen every two seconds.
    """
    lines = [
        "% LogFile created by the 'GetSensorData' App for Android.",
        "% Date of creation: Tue Nov 14 23:13:20 GMT+01:00 2023",
        "% Manufacturer:  samsung",
        "% Model:   SM-A520F",
        "",
    ]
    q = walk["rotation"][:, 1:] * np.sign(walk["rotation"][:, 1:2])
    kinds = [(name, lines_of(walk[sensor][:, 1:], ";")) for name, sensor in _GETSENSORDATA.items()]
    kinds.append(("AHRS", [f"1;2;3;{numbers}" for numbers in lines_of(q[:, 1:], ";")]))
    for row, t in enumerate(walk["accel"][:, 0].tolist()):
        head = f"{t + 0.003:.4f};{t + 5000:.6f}"
        lines += [f"{name};{head};{numbers[row]};3" for name, numbers in kinds]
        if scans and row % 200 == 0:
            lines += [f"WIFI;{head};a;b;20:23:00:00:00:{k:02d};2437;-{60 + k};" for k in range(16)]
        if row == 100:
            frequency = "" if old else "2412;"
            lines.append(f"WIFI;1.5;5001.2;a;{'name' if old else 'b'};{ADDRESS};{frequency}-61{'' if old else ';'}")
            lines.append("BLE4;1.5;7;12;-80" if old else "BLE4;1.5;iBeacon;BE:AC:20:23:00:01;-90;-59;1;1;11111111-1111")
        if row in (50, 2500):
            lines.append(f"POSI;{t};1;{49.46 + row * 1e-6:.9f};11.11;{1 if row == 50 else -1};100")
    content = "\n".join([*lines, ""])
    return _write(folder / "log.txt", (content.replace(".", ",") if comma else content).encode())


_GETSENSORDATA: Final = {"ACCE": "accel", "GYRO": "gyro", "MAGN": "mag", "PRES": "baro"}


def sensor_logger(walk: Rows, *, apple: bool, standardised: bool = False) -> Files:
    """The files of an export of Sensor Logger."""
    sign = -1.0 if apple and not standardised else 1.0
    zyx = [0, 3, 2, 1]
    linear, gravity = walk["accel"].copy(), walk["gravity"].copy()
    linear[:, 1:] -= gravity[:, 1:]
    linear[:, 1:] *= sign
    gravity[:, 1:] *= sign
    q = walk["rotation"].copy()
    if apple and not standardised:  # against x north, and from there to the device
        north = Rotation.from_euler("z", -90, degrees=True) * Rotation.from_quat(q[:, [2, 3, 4, 1]])
        q[:, 1:] = north.inv().as_quat()[:, [3, 0, 1, 2]]
    vectors = {
        "Accelerometer": linear,
        "Gravity": gravity,
        "Gyroscope": walk["gyro"],
        "Magnetometer": walk["mag"],
        **({} if apple else {"TotalAcceleration": walk["accel"]}),
    }
    begin = "time,seconds_elapsed"
    return {
        **{f"{name}.csv": _stamped(table[:, zyx], "z,y,x") for name, table in vectors.items()},
        "Orientation.csv": _stamped(q[:, [0, 4, 3, 2, 1]], "qz,qy,qx,qw"),
        "Barometer.csv": _stamped(walk["baro"], "pressure"),
        "WiFi.csv": f"{begin},bssid,ssid,level,frequency\n{START_NS},0,{ADDRESS},my home,-60,2412\n".encode(),
        "Bluetooth-1.csv": f"{begin},id,rssi,txPowerLevel\n{START_NS},0,a,-70,-59\n".encode(),
        "Bluetooth-2.csv": f"{begin},id,rssi\n{START_NS + 10**9},1,b,-80\n".encode(),
        "Pedometer.csv": b"",
        "Metadata.csv": (
            "version,device name,platform,appVersion,standardisation\n"
            f"3,Pixel 7,{'ios' if apple else 'android'},1.48,{str(standardised).lower()}"
        ).encode(),
    }


def _stamped(table: FloatArray, names: str) -> bytes:
    """A table of Sensor Logger, whose rows begin with nanoseconds since 1970 and seconds since the start."""
    stamps = [f"{_stamp_ns(t)},{t:.6f}" for t in table[:, 0].tolist()]
    rows = [f"{stamp},{row}" for stamp, row in zip(stamps, lines_of(table[:, 1:]), strict=True)]
    return "\n".join([f"time,seconds_elapsed,{names}", *rows, ""]).encode()


def sensor_logger_json(folder: Path, walk: Rows) -> Path:
    """The JSON export of Sensor Logger, whose numbers are texts."""
    samples: list[dict[str, str]] = [{"sensor": "Metadata", "platform": "android"}]
    for name, sensor, keys in (
        ("TotalAcceleration", "accel", XYZ),
        ("Gyroscope", "gyro", XYZ),
        ("Magnetometer", "mag", XYZ),
        ("Orientation", "rotation", ("qw", "qx", "qy", "qz")),
        ("Barometer", "baro", ("pressure",)),
    ):
        for t, *values in walk[sensor].tolist():
            numbers = {key: f"{value:.9g}" for key, value in zip(keys, values, strict=True)}
            samples.append({"sensor": name, "time": str(_stamp_ns(t)), "seconds_elapsed": f"{t:.3f}", **numbers})
    return _write(folder / "export.json", json.dumps(samples).encode())


def phyphox(folder: Path, walk: Rows, *, separator: str = ",", comma: bool = False, apple: bool = False) -> Path:
    """The zip of a CSV export of phyphox."""
    files = {
        "meta/time.csv": separator.join(('"event"', '"experiment time"', '"system time"', '"system time text"'))
        + "\n"
        + separator.join(('"START"', "0", "1700000000.0", '"2023-11-14"'))
        + "\n",
        "meta/device.csv": f'"property"{separator}"value"\n"deviceModel"{separator}"Pixel"\n',
    }
    for name, sensor, begin, unit in (
        ("Accelerometer", "accel", "Acceleration", "m/s^2"),
        ("Gyroscope", "gyro", "Gyroscope", "rad/s"),
        ("Magnetometer", "mag", "Magnetic field", "µT"),
        ("Pressure", "baro", "Pressure", "hPa"),
    ):
        axes = [f'"{a.upper()} ({unit})"' if apple else f'"{begin} {a} ({unit})"' for a in XYZ]
        names = axes if sensor != "baro" else [f'"{begin} ({unit})"']
        files[f"{name}.csv"] = text_of(separator.join(['"Time (s)"', *names]), walk[sensor], separator, "%.9E").decode()
    return zip_of(
        folder / "walk 2023-11-14.zip",
        {name: (text.replace(".", ",") if comma else text).encode() for name, text in files.items()},
    )


def androsensor(folder: Path, walk: Rows) -> Path:
    """A recording of AndroSensor without the accelerometer itself."""
    gravity, linear = walk["gravity"][:, 1:], walk["accel"][:, 1:] - walk["gravity"][:, 1:]
    names = [
        _names("GRAVITY ", " (m/s²)"),
        _names("LINEAR ACCELERATION ", " (m/s²)"),
        _names("GYROSCOPE ", " (rad/s)"),
        _names("MAGNETIC FIELD ", " (µT)"),
        "ATMOSPHERIC PRESSURE (hPa)",
        "Time since start in ms ",
    ]
    others = [walk[sensor][:, 1:] for sensor in ("gyro", "mag", "baro")]
    table = np.column_stack([gravity, linear, *others, walk["accel"][:, 0] * 1e3])
    return _write(folder / "Sensor_record.csv", text_of(",".join(names), table).decode().encode("latin-1"))


def sensorlog(folder: Path, walk: Rows, *, motion_only: bool = False) -> Path:
    """A recording of SensorLog, of the raw accelerometer or of device motion alone."""
    gravity = walk["gravity"][:, 1:] / GRAVITY_MPS2
    linear = walk["accel"][:, 1:] / GRAVITY_MPS2 - gravity
    off = np.zeros_like(gravity)
    names = ["motionTimestamp_sinceReboot(s)", "altimeterPressure(kPa)"]
    names += [
        form.format(axis)
        for form in (
            "accelerometerAcceleration{}(G)",
            "motionUserAcceleration{}(G)",
            "motionGravity{}(G)",
            "motionRotationRate{}(rad/s)",
            "magnetometer{}(µT)",
        )
        for axis in "XYZ"
    ]
    raw = off if motion_only else -gravity - linear
    clock = walk["accel"][:, 0] + 51234.5
    values = [clock, walk["baro"][:, 1] / 10.0, raw, -linear, -gravity, walk["gyro"][:, 1:], off]
    rows = lines_of(np.column_stack(values), ";", "%.12g")
    lines = [";".join(["loggingTime(txt)", *names]), *(f"2024-04-05 21:34:38.000 +0200;{row}" for row in rows), ""]
    return _write(folder / "log.csv", "\n".join(lines).encode())


def xio(folder: Path, walk: Rows) -> Path:
    """A table of an inertial unit of x-io."""
    table = _table_of(walk, "gyro", "accel")
    table[:, 1:4] *= 180 / np.pi
    table[:, 4:7] /= GRAVITY_MPS2
    header = f"Time (s),{_names('Gyroscope ', ' (deg/s)')},{_names('Accelerometer ', ' (g)')}"
    return _write(folder / "walk.csv", text_of(header, table, form="%.12g"))


def xsens_dot(folder: Path, walk: Rows, *, free: bool = False) -> Path:
    """The CSV of a DOT; in a quaternion mode, without angular rates and gravity, where `free`."""
    q, t = walk["rotation"][:, 1:], walk["accel"][:, 0]
    ticks = (np.round(t * 1e6) + 4_294_000_000) % 2**32  # wraps within the walk
    if free:
        world = Rotation.from_quat(q[:, [1, 2, 3, 0]]).apply(walk["accel"][:, 1:]) - [0, 0, GRAVITY_MPS2]
        names, values = "Quat_W,Quat_X,Quat_Y,Quat_Z,FreeAcc_X,FreeAcc_Y,FreeAcc_Z", np.column_stack([q, world])
    else:
        names = "Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"
        values = np.column_stack([walk["accel"][:, 1:], walk["gyro"][:, 1:] * 180 / np.pi])
    top = "sep=,\nDeviceTag:,a\nOutputRate:,100Hz\nStartTime: ,2021-08-20_20:21:13_829 GMT+8\n© Xsens\n\n"
    table = np.column_stack([np.arange(len(t)) + 1, ticks, values])
    return _write(folder / "a.csv", text_of(f"{top}PacketCounter,SampleTimeFine,{names}", table, form="%.12g"))


def xsens_mt(folder: Path, walk: Rows) -> Path:
    """What MT Manager exports: an empty column, and matrices column by column."""
    matrix = Rotation.from_quat(walk["rotation"][:, [2, 3, 4, 1]]).as_matrix()
    names = ["PacketCounter", "SampleTimeFine", "Acc_X", "Acc_Y", "Acc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z"]
    names += ["Mag_X", "Mag_Y", "Mag_Z", "Pressure", *(f"Mat[{i + 1}][{j + 1}]" for j in range(3) for i in range(3))]
    units = (("accel", 1.0), ("gyro", 1.0), ("mag", 0.02), ("baro", 100.0))
    values = [walk[sensor][:, 1:] * unit for sensor, unit in units]
    rows = lines_of(np.column_stack([*values, matrix.transpose(0, 2, 1).reshape(-1, 9)]), "\t")
    lines = [f"{(row + 65_000) % 65_536:05d}\t\t{line}" for row, line in enumerate(rows)]
    top = ["// Start Time: Unknown", "// Update Rate: 100.0Hz", "\t".join(names)]
    return _write(folder / "MT_1.txt", "\n".join([*top, *lines, ""]).encode())


def ridi(folder: Path, walk: Rows) -> Path:
    """A walk of RIDI."""
    table = _table_of(walk, "gyro", "accel", "gravity", "mag", "rotation")
    place = np.column_stack([table[:, 0], 2 * table[:, 0], 0 * table[:, 0]])
    table = np.column_stack([np.arange(len(table)), table[:, 0] * 1e9 + 5e12, table[:, 1:], place])
    groups = ",".join(_names(f"{group}_", axes="xyz") for group in ("gyro", "acce", "grav", "magnet"))
    header = f",time,{groups},{_names('rv_', axes='wxyz')},{_names('pos_', axes='xyz')}"
    return _write(folder / "processed" / "data.csv", text_of(header, table, form="%.12g"))


def oxiod(folder: Path, walk: Rows) -> Path:
    """A walk of OxIOD with its reference beside it."""
    t, force = walk["accel"][:, 0], -walk["accel"][:, 1:] / GRAVITY_MPS2
    gravity = -walk["gravity"][:, 1:] / GRAVITY_MPS2
    values = [t, np.zeros((len(t), 3)), walk["gyro"][:, 1:], gravity, force - gravity, walk["mag"][:, 1:]]
    place = np.column_stack([t, np.arange(len(t)), t, 2 * t, 0 * t, np.zeros((len(t), 3)), np.ones(len(t))])
    _write(folder / "vi1.csv", text_of("", place, form="%.12g"))
    return _write(folder / "imu1.csv", text_of("", np.column_stack(values), form="%.12g"))


def euroc(folder: Path, walk: Rows) -> Path:
    """A sequence in the layout of EuRoC, with lines that end as on Windows."""
    table = _table_of(walk, "gyro", "accel")
    seconds = table[:, 0].tolist()
    units = ("[rad s^-1]", "[m s^-2]")
    header = "#timestamp [ns]," + ",".join(f"{n}_RS_S_{a} {u}" for n, u in zip("wa", units, strict=True) for a in XYZ)
    rows = [f"{_stamp_ns(t)},{row}" for t, row in zip(seconds, lines_of(table[:, 1:]), strict=True)]
    truth = ["#timestamp [ns], p_x, p_y, p_z", *(f"{_stamp_ns(t)},{t},{2 * t},0" for t in seconds), ""]
    imu = "\r\n".join([header, *rows, ""]).encode()
    return folder_of(folder / "seq", {"mav0/imu0/data.csv": imu, "mav0/mocap0/data.csv": "\n".join(truth).encode()})


def bag(folder: Path, walk: Rows, *, version: int, storage: str = "MCAP") -> Path:
    """A bag of ROS 1 or 2; needs rosbags."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    path = folder / ("walk.bag" if version == 1 else "walk")
    writer: Any = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=StoragePlugin[storage])
    serialise = store.serialize_ros1 if version == 1 else store.serialize_cdr
    header = partial(types["std_msgs/msg/Header"], **({"seq": 0} if version == 1 else {}))
    nine = np.full(9, 0.01)
    with writer:
        kinds = ("Imu", "MagneticField", "FluidPressure")
        topics = {
            kind: writer.add_connection(f"/{kind.lower()}", f"sensor_msgs/msg/{kind}", typestore=store)
            for kind in kinds
        }
        tables = (walk[name].tolist() for name in ("accel", "gyro", "rotation", "mag", "baro"))
        for a, w, q, m, p in zip(*tables, strict=True):
            ns = _stamp_ns(a[0])
            at = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="imu")
            turn = quaternion(q[2], q[3], q[4], q[1])
            numbers: tuple[tuple[Any, ...], ...] = (
                (turn, nine, vector(*w[1:]), nine, vector(*a[1:]), nine),
                (vector(*(1e-6 * value for value in m[1:])), nine),
                (100.0 * p[1], 0.0),
            )
            for kind, values in zip(kinds, numbers, strict=True):
                message = types[f"sensor_msgs/msg/{kind}"](at, *values)
                writer.write(topics[kind], ns + 36_000_000, serialise(message, topics[kind].msgtype))
    return path


def json_mcap(folder: Path, walk: Rows) -> Path:
    """Messages in JSON in an MCAP file; needs mcap."""
    from mcap.writer import Writer

    path = folder / "walk.mcap"
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        channels = {}
        for kind in ("Imu", "MagneticField", "FluidPressure"):
            schema = writer.register_schema(f"sensor_msgs/msg/{kind}", "jsonschema", b"{}")
            channels[kind] = writer.register_channel(f"/{kind.lower()}", "json", schema)
        tables = (walk[name].tolist() for name in ("accel", "gyro", "rotation", "mag", "baro"))
        for a, w, q, m, p in zip(*tables, strict=True):
            ns = _stamp_ns(a[0])
            header = {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}}
            messages: dict[str, dict[str, object]] = {
                "Imu": {
                    "angular_velocity": dict(zip(XYZ, w[1:], strict=True)),
                    "linear_acceleration": dict(zip(XYZ, a[1:], strict=True)),
                    "orientation": dict(zip("wxyz", q[1:], strict=True)),
                },
                "MagneticField": {"magnetic_field": {axis: 1e-6 * v for axis, v in zip(XYZ, m[1:], strict=True)}},
                "FluidPressure": {"fluid_pressure": 100.0 * p[1]},
            }
            for kind, message in messages.items():
                writer.add_message(channels[kind], ns, json.dumps({"header": header, **message}).encode(), ns)
        writer.finish()
    return path


def ronin(folder: Path, walk: Rows) -> Path:
    """A walk of RoNIN with its calibration; needs h5py."""
    import h5py

    place = folder / "a000_1"
    place.mkdir()
    t = walk["accel"][:, 0]
    with h5py.File(place / "data.hdf5", "w") as file:
        file["synced/time"] = t + 100.0
        file["synced/acce"] = walk["accel"][:, 1:] / 1.01 + 0.1
        file["synced/gyro_uncalib"] = walk["gyro"][:, 1:] + 0.02
        file["synced/magnet"] = walk["mag"][:, 1:]
        file["synced/game_rv"] = walk["rotation"][:, 1:]
        file["pose/tango_pos"] = np.column_stack([t, 2 * t, 0 * t])
    info = {
        "imu_acce_scale": [1.01] * 3,
        "imu_acce_bias": [0.1] * 3,
        "imu_init_gyro_bias": [0.02] * 3,
        "start_frame": min(100, len(t) // 2),
    }
    _write(place / "info.json", json.dumps(info).encode())
    return place


def csv(folder: Path, walk: Rows) -> Path:
    """A table of a logger without a format of its own, with semicolons and milliseconds."""
    table = _table_of(walk, "accel", "gyro", "mag", "rotation", "baro")
    header = "timestamp_ms;ax (m/s^2);ay;az;gyroX [rad/s];gyroY;gyroZ;mag_x (uT);mag_y;mag_z;qw;qx;qy;qz;pressure (hPa)"
    table[:, 0] *= 1e3
    return _write(folder / "any.csv", text_of(header, table, ";", "%.12g"))


@dataclass(frozen=True, slots=True)
class Sample:
    """One way in which a format is written."""

    reader: str  # key of `pdrbench.io.READERS`
    write: Callable[[Path, Rows], Path]  # takes a folder and a walk, as from `make_walk`; returns the path to read
    streams: tuple[str, ...]  # what is read from it: sensors, and "reference" where the file holds places
    needs: str = ""  # the library that writes it, beside those of pdrbench itself


def _sample(reader: str, write: Callable[[Path, Rows], Path], streams: str, needs: str = "") -> Sample:
    return Sample(reader, write, tuple(streams.split()), needs)


def _zipped(prefix: str, **options: bool) -> Callable[[Path, Rows], Path]:
    return lambda folder, walk: zip_of(
        folder / "a.zip", {f"{prefix}{name}": content for name, content in sensor_logger(walk, **options).items()}
    )


_PHONE: Final = "accel gyro mag rotation baro"
SAMPLES: Final[Mapping[str, Sample]] = {
    "getsensordata": _sample("getsensordata", getsensordata, f"{_PHONE} wifi ble reference"),
    "getsensordata, commas": _sample("getsensordata", partial(getsensordata, comma=True), f"{_PHONE} reference"),
    "getsensordata, 2016": _sample("getsensordata", partial(getsensordata, old=True), f"{_PHONE} wifi ble"),
    "sensor logger, iOS": _sample("sensor_logger", _zipped("", apple=True), f"{_PHONE} wifi"),
    "sensor logger, iOS standardised, in a folder": _sample(
        "sensor_logger", _zipped("b/", apple=True, standardised=True), _PHONE
    ),
    "sensor logger, Android": _sample(
        "sensor_logger",
        lambda folder, walk: folder_of(folder / "a", sensor_logger(walk, apple=False)),
        f"{_PHONE} wifi",
    ),
    "sensor logger, JSON": _sample("sensor_logger", sensor_logger_json, _PHONE),
    "phyphox": _sample("phyphox", phyphox, "accel gyro mag baro"),
    "phyphox, decimal commas": _sample("phyphox", partial(phyphox, separator=";", comma=True), "accel gyro mag baro"),
    "phyphox, iOS, tabs": _sample("phyphox", partial(phyphox, separator="\t", apple=True), "accel gyro mag baro"),
    "androsensor": _sample("androsensor", androsensor, "accel gyro mag baro"),
    "sensorlog": _sample("sensorlog", sensorlog, "accel gyro baro"),
    "sensorlog, device motion": _sample("sensorlog", partial(sensorlog, motion_only=True), "accel gyro baro"),
    "xio": _sample("xio", xio, "accel gyro"),
    "xsens dot": _sample("xsens", xsens_dot, "accel gyro"),
    "xsens dot, quaternions": _sample("xsens", partial(xsens_dot, free=True), "accel rotation"),
    "xsens mt": _sample("xsens", xsens_mt, "accel gyro rotation baro"),
    "ridi": _sample("ridi", ridi, "accel gyro mag rotation reference"),
    "oxiod": _sample("oxiod", oxiod, "accel gyro mag reference"),
    "euroc": _sample("euroc", euroc, "accel gyro reference"),
    "ros 1": _sample("ros", partial(bag, version=1), _PHONE, "rosbags"),
    "ros 2": _sample("ros", partial(bag, version=2), _PHONE, "rosbags"),
    "ros 2, SQLite": _sample("ros", partial(bag, version=2, storage="SQLITE3"), _PHONE, "rosbags"),
    "mcap, JSON": _sample("ros", json_mcap, _PHONE, "mcap"),
    "ronin": _sample("ronin", ronin, "accel gyro mag rotation reference", "h5py"),
    "csv": _sample("csv", csv, _PHONE),
}
