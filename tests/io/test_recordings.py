"""Recordings that people bring: one walk in every format, every bad input in every format, real files where found."""

from __future__ import annotations

import gzip
import io
import json
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pdrbench.errors import RecordingError
from pdrbench.io import READERS
from pdrbench.io.detect import detect, read
from pdrbench.io.log import Log
from pdrbench.io.opaque import opaque_id
from pdrbench_formats.recordings import csv_columns, getsensordata
from pdrbench_formats.recordings.columnmap import read_column_map

Rows = dict[str, np.ndarray]
G = 9.80665
START_NS = 1_700_000_000_000_000_000
XYZ = ("x", "y", "z")


def text(header: str, table: np.ndarray, separator: str = ",", form: str = "%.9g") -> str:
    out = io.StringIO()
    np.savetxt(out, table, fmt=form, delimiter=separator)
    return (header + "\n" if header else "") + out.getvalue()


def files_of(folder: Path, files: dict[str, str | bytes]) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def zip_of(path: Path, files: dict[str, str | bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def stamped(table: np.ndarray) -> list[str]:
    """`time,seconds_elapsed` of Sensor Logger."""
    return [f"{START_NS + round(t * 1e9)},{t:.6f}" for t in table[:, 0]]


def sensor_logger_csv(table: np.ndarray, names: tuple[str, ...]) -> str:
    lines = [
        f"{head},{','.join(f'{v:.9g}' for v in row)}" for head, row in zip(stamped(table), table[:, 1:], strict=True)
    ]
    return "\n".join([f"time,seconds_elapsed,{','.join(names)}", *lines, ""])


def sensor_logger(walk: Rows, *, apple: bool, standardised: bool = False) -> dict[str, str | bytes]:
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
    return {
        "Accelerometer.csv": sensor_logger_csv(linear[:, zyx], ("z", "y", "x")),
        "Gravity.csv": sensor_logger_csv(gravity[:, zyx], ("z", "y", "x")),
        "Gyroscope.csv": sensor_logger_csv(walk["gyro"][:, zyx], ("z", "y", "x")),
        "Magnetometer.csv": sensor_logger_csv(walk["mag"][:, zyx], ("z", "y", "x")),
        "Orientation.csv": sensor_logger_csv(q[:, [0, 4, 3, 2, 1]], ("qz", "qy", "qx", "qw")),
        "Barometer.csv": sensor_logger_csv(walk["baro"], ("pressure",)),
        "WiFi.csv": "time,seconds_elapsed,bssid,ssid,level,frequency\n"
        f"{START_NS},0,02:00:00:00:00:01,my home,-60,2412\n",
        "Bluetooth-1.csv": f"time,seconds_elapsed,id,rssi,txPowerLevel\n{START_NS},0,a,-70,-59\n",
        "Bluetooth-2.csv": f"time,seconds_elapsed,id,rssi\n{START_NS + 10**9},1,b,-80\n",
        "Pedometer.csv": "",
        "Metadata.csv": f"version,device name,platform,appVersion,standardisation\n3,Pixel 7,"
        f"{'ios' if apple else 'android'},1.48,{str(standardised).lower()}",
    }


def write_android(folder: Path, walk: Rows) -> Path:
    files = sensor_logger(walk, apple=False)
    files["TotalAcceleration.csv"] = sensor_logger_csv(walk["accel"][:, [0, 3, 2, 1]], ("z", "y", "x"))
    return files_of(folder / "export", files)


def write_sensor_logger_json(folder: Path, walk: Rows) -> Path:
    samples = [{"sensor": "Metadata", "platform": "android"}]
    for name, sensor in (("TotalAcceleration", "accel"), ("Gyroscope", "gyro")):
        for row in walk[sensor]:
            stamp = {"time": str(START_NS + round(row[0] * 1e9)), "seconds_elapsed": f"{row[0]:.3f}"}
            samples.append({"sensor": name, **stamp, **{a: f"{v:.9g}" for a, v in zip(XYZ, row[1:], strict=True)}})
    path = folder / "export.json"
    path.write_text(json.dumps(samples))
    return path


def write_getsensordata(folder: Path, walk: Rows, *, comma: bool = False, old: bool = False) -> Path:
    lines = [
        "% LogFile created by the 'GetSensorData' App for Android.",
        "% Date of creation: Tue Nov 14 23:13:20 GMT+01:00 2023",
        "% Manufacturer:  samsung",
        "% Model:   SM-A520F",
        "",
    ]
    for row in range(len(walk["accel"])):
        t = walk["accel"][row, 0]
        head = f"{t + 0.003:.4f};{t + 5000:.6f}"
        for name, sensor in (("ACCE", "accel"), ("GYRO", "gyro"), ("MAGN", "mag"), ("PRES", "baro")):
            lines.append(f"{name};{head};" + ";".join(f"{v:.9g}" for v in walk[sensor][row, 1:]) + ";3")
        q = walk["rotation"][row, 1:] * np.sign(walk["rotation"][row, 1])
        lines.append(f"AHRS;{head};1;2;3;" + ";".join(f"{v:.9g}" for v in q[1:]) + ";3")
        if row == 100:
            lines.append(
                "WIFI;1.5;5001.2;a;name;02:00:00:00:00:01;-61"
                if old
                else "WIFI;1.5;5001.2;a;b;02:00:00:00:00:01;2412;-61;"
            )
            lines.append("BLE4;1.5;7;12;-80" if old else "BLE4;1.5;iBeacon;BE:AC:20:23:00:01;-90;-59;1;1;11111111-1111")
        if row in (50, 2500):
            lines.append(f"POSI;{t};1;{49.46 + row * 1e-6:.9f};11.11;{1 if row == 50 else -1};100")
    content = "\n".join([*lines, ""])
    path = folder / "log.txt"
    path.write_text(content.replace(".", ",") if comma else content)
    return path


def write_phyphox(folder: Path, walk: Rows, *, separator: str = ",", comma: bool = False, apple: bool = False) -> Path:
    names = {"Accelerometer": ("accel", "Acceleration", "m/s^2"), "Gyroscope": ("gyro", "Gyroscope", "rad/s")}
    files: dict[str, str | bytes] = {
        "meta/time.csv": separator.join(('"event"', '"experiment time"', '"system time"', '"system time text"'))
        + "\n"
        + separator.join(('"START"', "0", "1700000000.0", '"2023-11-14"'))
        + "\n",
        "meta/device.csv": f'"property"{separator}"value"\n"deviceModel"{separator}"Pixel"\n',
    }
    for name, (sensor, begin, unit) in names.items():
        axes = [f'"{a.upper()} ({unit})"' if apple else f'"{begin} {a} ({unit})"' for a in XYZ]
        files[f"{name}.csv"] = text(separator.join(['"Time (s)"', *axes]), walk[sensor], separator, "%.9E")
    if comma:
        files = {name: str(content).replace(".", ",") for name, content in files.items()}
    return zip_of(folder / "walk 2023-11-14.zip", files)


def table_of(walk: Rows, *sensors: str) -> np.ndarray:
    return np.column_stack([walk["accel"][:, 0], *(walk[name][:, 1:] for name in sensors)])


def write_table(path: Path, header: str, table: np.ndarray, separator: str = ",", form: Any = "%.12g") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text(header, table, separator, form))
    return path


def columns_of(begin: str, unit: str = "", axes: str = "XYZ") -> str:
    return ",".join(f"{begin}{axis}{unit}" for axis in axes)


def write_androsensor(folder: Path, walk: Rows) -> Path:
    gravity, linear = walk["gravity"], walk["accel"].copy()
    linear[:, 1:] -= gravity[:, 1:]
    header = ",".join(
        [
            columns_of("GRAVITY ", " (m/s²)"),
            columns_of("LINEAR ACCELERATION ", " (m/s²)"),
            columns_of("GYROSCOPE ", " (rad/s)"),
        ]
    )
    table = np.column_stack([gravity[:, 1:], linear[:, 1:], walk["gyro"][:, 1:], walk["accel"][:, 0] * 1e3])
    path = folder / "Sensor_record.csv"
    path.write_bytes(text(f"{header},Time since start in ms ", table).encode("latin-1"))
    return path


def write_xio(folder: Path, walk: Rows) -> Path:
    table = table_of(walk, "gyro", "accel")
    table[:, 1:4] *= 180 / np.pi
    table[:, 4:7] /= G
    header = f"Time (s),{columns_of('Gyroscope ', ' (deg/s)')},{columns_of('Accelerometer ', ' (g)')}"
    return write_table(folder / "walk.csv", header, table)


def write_dot(folder: Path, walk: Rows, *, free: bool = False) -> Path:
    q, t = walk["rotation"][:, 1:], walk["accel"][:, 0]
    ticks = (np.round(t * 1e6) + 4_294_000_000) % 2**32  # wraps within the walk
    if free:
        world = Rotation.from_quat(q[:, [1, 2, 3, 0]]).apply(walk["accel"][:, 1:]) - [0, 0, G]
        names, values = "Quat_W,Quat_X,Quat_Y,Quat_Z,FreeAcc_X,FreeAcc_Y,FreeAcc_Z", np.column_stack([q, world])
    else:
        names = "Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"
        values = np.column_stack([walk["accel"][:, 1:], walk["gyro"][:, 1:] * 180 / np.pi])
    top = "sep=,\nDeviceTag:,a\nOutputRate:,100Hz\nStartTime: ,2021-08-20_20:21:13_829 GMT+8\n© Xsens\n\n"
    table = np.column_stack([np.arange(len(t)) + 1, ticks, values])
    return write_table(folder / "a.csv", f"{top}PacketCounter,SampleTimeFine,{names}", table, form="%.12g")


def write_mt(folder: Path, walk: Rows) -> Path:
    t = walk["accel"][:, 0]
    matrix = Rotation.from_quat(walk["rotation"][:, [2, 3, 4, 1]]).as_matrix()
    names = ["PacketCounter", "SampleTimeFine", "Acc_X", "Acc_Y", "Acc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z"]
    names += [f"Mat[{i + 1}][{j + 1}]" for j in range(3) for i in range(3)]
    values = [walk["accel"][:, 1:], walk["gyro"][:, 1:], matrix.transpose(0, 2, 1).reshape(-1, 9)]
    table = np.column_stack([(np.arange(len(t)) + 65_000) % 65_536, *values])
    lines = ["\t".join([f"{row[0]:05.0f}", "", *(f"{v:.9g}" for v in row[1:])]) for row in table]
    path = folder / "MT_1.txt"
    path.write_text("\n".join(["// Start Time: Unknown", "// Update Rate: 100.0Hz", "\t".join(names), *lines, ""]))
    return path


def write_ridi(folder: Path, walk: Rows) -> Path:
    table = table_of(walk, "gyro", "accel", "gravity", "mag", "rotation")
    place = np.column_stack([table[:, 0], 2 * table[:, 0], 0 * table[:, 0]])
    table = np.column_stack([np.arange(len(table)), table[:, 0] * 1e9 + 5e12, table[:, 1:], place])
    groups = ("gyro", "acce", "grav", "magnet")
    header = ",time," + ",".join(columns_of(f"{g}_", axes="xyz") for g in groups)
    return write_table(
        folder / "processed" / "data.csv",
        f"{header},{columns_of('rv_', axes='wxyz')},{columns_of('pos_', axes='xyz')}",
        table,
    )


def write_oxiod(folder: Path, walk: Rows) -> Path:
    t, force = walk["accel"][:, 0], -walk["accel"][:, 1:] / G
    gravity = -walk["gravity"][:, 1:] / G
    values = [t, np.zeros((len(t), 3)), walk["gyro"][:, 1:], gravity, force - gravity, walk["mag"][:, 1:]]
    place = np.column_stack([t, np.arange(len(t)), t, 2 * t, 0 * t, np.zeros((len(t), 3)), np.ones(len(t))])
    write_table(folder / "vi1.csv", "", place)
    return write_table(folder / "imu1.csv", "", np.column_stack(values))


def write_euroc(folder: Path, walk: Rows) -> Path:
    table = table_of(walk, "gyro", "accel")
    ns = [f"{START_NS + round(t * 1e9)}" for t in table[:, 0]]
    units = ("[rad s^-1]", "[m s^-2]")
    header = "#timestamp [ns]," + ",".join(f"{n}_RS_S_{a} {u}" for n, u in zip("wa", units, strict=True) for a in XYZ)
    imu = "\r\n".join(
        [header, *(f"{n},{','.join(f'{v:.9g}' for v in row)}" for n, row in zip(ns, table[:, 1:], strict=True)), ""]
    )
    truth = "\n".join(
        ["#timestamp [ns], p_x, p_y, p_z", *(f"{n},{t},{2 * t},0" for n, t in zip(ns, table[:, 0], strict=True)), ""]
    )
    return files_of(folder / "seq", {"mav0/imu0/data.csv": imu, "mav0/mocap0/data.csv": truth})


def write_bag(folder: Path, walk: Rows, *, version: int) -> Path:
    pytest.importorskip("rosbags", reason="pip install pdrbench[formats]")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    path = folder / ("walk.bag" if version == 1 else "walk")
    writer = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP)
    extra = {"seq": 0} if version == 1 else {}
    nine = np.full(9, 0.01)
    with writer:
        topic = writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        for a, w, q in zip(walk["accel"], walk["gyro"], walk["rotation"], strict=True):
            ns = START_NS + round(a[0] * 1e9)
            at = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="imu", **extra)
            message = types["sensor_msgs/msg/Imu"](
                at, quaternion(q[2], q[3], q[4], q[1]), nine, vector(*w[1:]), nine, vector(*a[1:]), nine
            )
            data = (
                store.serialize_ros1(message, topic.msgtype)
                if version == 1
                else store.serialize_cdr(message, topic.msgtype)
            )
            writer.write(topic, ns + 36_000_000, data)
    return path


def write_json_mcap(folder: Path, walk: Rows) -> Path:
    pytest.importorskip("mcap", reason="pip install pdrbench[formats]")
    from mcap.writer import Writer

    path = folder / "walk.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Imu", "jsonschema", b"{}")
        channel = writer.register_channel("/imu", "json", schema)
        for a, w, q in zip(walk["accel"], walk["gyro"], walk["rotation"], strict=True):
            ns = START_NS + round(a[0] * 1e9)
            message = {
                "header": {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}},
                "angular_velocity": dict(zip(XYZ, w[1:], strict=True)),
                "linear_acceleration": dict(zip(XYZ, a[1:], strict=True)),
                "orientation": dict(zip("wxyz", q[1:], strict=True)),
            }
            writer.add_message(channel, ns, json.dumps(message).encode(), ns)
        writer.finish()
    return path


def write_ronin(folder: Path, walk: Rows) -> Path:
    h5py = pytest.importorskip("h5py", reason="pip install pdrbench[formats]")
    place = folder / "a000_1"
    place.mkdir()
    t = walk["accel"][:, 0]
    with h5py.File(place / "data.hdf5", "w") as file:
        file["synced/time"] = t + 100.0
        file["synced/acce"] = walk["accel"][:, 1:] / 1.01 + 0.1
        file["synced/gyro_uncalib"] = walk["gyro"][:, 1:] + 0.02
        file["synced/game_rv"] = walk["rotation"][:, 1:]
        file["pose/tango_pos"] = np.column_stack([t, 2 * t, 0 * t])
    info = {
        "imu_acce_scale": [1.01] * 3,
        "imu_acce_bias": [0.1] * 3,
        "imu_init_gyro_bias": [0.02] * 3,
        "start_frame": 100,
    }
    (place / "info.json").write_text(json.dumps(info))
    return place


def write_csv(folder: Path, walk: Rows) -> Path:
    table = table_of(walk, "accel", "gyro", "mag", "rotation", "baro")
    header = "timestamp_ms;ax (m/s^2);ay;az;gyroX [rad/s];gyroY;gyroZ;mag_x (uT);mag_y;mag_z;qw;qx;qy;qz;pressure (hPa)"
    table[:, 0] *= 1e3
    return write_table(folder / "any.csv", header, table, ";")


WRITERS: dict[str, tuple[str, Callable[[Path, Rows], Path], str]] = {
    "getsensordata": ("getsensordata", write_getsensordata, "accel gyro mag baro rotation wifi ble reference"),
    "getsensordata, commas": (
        "getsensordata",
        lambda f, w: write_getsensordata(f, w, comma=True),
        "accel gyro reference",
    ),
    "getsensordata, 2016": ("getsensordata", lambda f, w: write_getsensordata(f, w, old=True), "accel wifi ble"),
    "sensor logger, iOS": (
        "sensor_logger",
        lambda f, w: zip_of(f / "a.zip", sensor_logger(w, apple=True)),
        "accel gyro mag rotation baro wifi",
    ),
    "sensor logger, iOS standardised, in a folder": (
        "sensor_logger",
        lambda f, w: zip_of(
            f / "a.zip", {f"b/{n}": c for n, c in sensor_logger(w, apple=True, standardised=True).items()}
        ),
        "accel gyro mag rotation baro",
    ),
    "sensor logger, Android": ("sensor_logger", write_android, "accel gyro mag rotation baro wifi"),
    "sensor logger, JSON": ("sensor_logger", write_sensor_logger_json, "accel gyro"),
    "phyphox": ("phyphox", write_phyphox, "accel gyro"),
    "phyphox, decimal commas": ("phyphox", lambda f, w: write_phyphox(f, w, separator=";", comma=True), "accel gyro"),
    "phyphox, iOS, tabs": ("phyphox", lambda f, w: write_phyphox(f, w, separator="\t", apple=True), "accel gyro"),
    "androsensor": ("androsensor", write_androsensor, "accel gyro"),
    "xio": ("xio", write_xio, "accel gyro"),
    "xsens dot": ("xsens", write_dot, "accel gyro"),
    "xsens dot, quaternions": ("xsens", lambda f, w: write_dot(f, w, free=True), "accel rotation"),
    "xsens mt": ("xsens", write_mt, "accel gyro rotation"),
    "ridi": ("ridi", write_ridi, "accel gyro mag rotation reference"),
    "oxiod": ("oxiod", write_oxiod, "accel gyro mag reference"),
    "euroc": ("euroc", write_euroc, "accel gyro reference"),
    "ros 1": ("ros", lambda f, w: write_bag(f, w, version=1), "accel gyro rotation"),
    "ros 2": ("ros", lambda f, w: write_bag(f, w, version=2), "accel gyro rotation"),
    "mcap, JSON": ("ros", write_json_mcap, "accel gyro rotation"),
    "ronin": ("ronin", write_ronin, "accel gyro rotation reference"),
    "csv": ("csv", write_csv, "accel gyro mag rotation baro"),
}


class TestOneWalkInEveryFormat:
    """The same motion, written as each app or device writes it, gives the same streams."""

    @pytest.mark.parametrize("name", WRITERS)
    def test_streams_are_those_of_the_walk(self, name: str, phone_walk: Rows, tmp_path: Path) -> None:
        kind, write, sensors = WRITERS[name]
        path = write(tmp_path, phone_walk)
        assert detect(path) == kind
        log = read(path)
        assert isinstance(log, Log)
        for sensor in sensors.split():
            if sensor == "reference":
                assert len(log.reference) >= 2
                assert log.reference.surveyed.all()
            elif sensor in ("wifi", "ble"):
                assert len(log.rows[sensor]) == 1
            else:
                rows, truth = log.rows[sensor], phone_walk[sensor]
                assert rows.shape == truth.shape
                np.testing.assert_allclose(rows[:, 0] - rows[0, 0], truth[:, 0], atol=2e-4)
                values = rows[:, 1:]
                if sensor == "rotation":  # q and -q are one attitude
                    values = values * np.sign((values * truth[:, 1:]).sum(axis=1))[:, None]
                np.testing.assert_allclose(values, truth[:, 1:], atol=2e-4)
        assert not [finding for finding in log.findings if finding.severity == "error"]

    def test_the_reference_is_in_metres_about_its_place(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(write_getsensordata(tmp_path, phone_walk))
        assert log.geo is not None
        assert log.reference.level.tolist() == [1, -1]
        north_m = float(np.diff(log.reference.xy_m[:, 1])[0])
        assert north_m == pytest.approx(2450e-6 * 111_240, rel=1e-3)  # metres in a degree at 49.46 north
        assert (log.device, log.start_unix_s) == ("samsung SM-A520F", pytest.approx(1_700_000_000, abs=1.0))

    def test_radio_has_numbers_in_place_of_addresses(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(write_getsensordata(tmp_path, phone_walk))
        same = opaque_id("wifi", "02:00:00:00:00:01")
        assert log.rows["wifi"][0, 1:4].tolist() == [same, -61.0, 2412.0]
        assert log.rows["wifi"][0, 4] == pytest.approx(0.297, abs=2e-3)  # arrived at 1.5 s, received at 1.2 s
        assert log.rows["ble"][0, 2:].tolist() == [-90.0, -59.0]
        other = read(zip_of(tmp_path / "a.zip", sensor_logger(phone_walk, apple=True)))
        assert other.rows["wifi"][0, 1] == same
        assert other.rows["ble"][:, 1].tolist() == [opaque_id("ble", "a"), opaque_id("ble", "b")]

    def test_a_log_is_read_in_parts(self, phone_walk: Rows, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = write_getsensordata(tmp_path, phone_walk)
        whole, seen = read(path), []
        monkeypatch.setattr(getsensordata, "CHUNK_BYTES", 50_000)
        parts = read(path, progress=seen.append)
        assert len(seen) > 10
        assert sum(seen) == path.stat().st_size
        (tmp_path / "log.txt.gz").write_bytes(gzip.compress(path.read_bytes()))
        for log in (parts, read(tmp_path / "log.txt.gz")):
            for sensor, rows in whole.rows.items():
                np.testing.assert_array_equal(log.rows[sensor], rows)

    def test_an_archive_of_one_file_is_that_file(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = write_getsensordata(tmp_path, phone_walk)
        packed = zip_of(tmp_path / "a.zip", {"logs/log.txt": log.read_bytes()})
        assert detect(packed) == "getsensordata"
        np.testing.assert_array_equal(read(packed).rows["accel"], read(log).rows["accel"])
        broken = zip_of(tmp_path / "b.zip", {"log.txt": log.read_bytes() + b"ACCE;a;b;c;d;e;3\n%\n"})
        with pytest.raises(RecordingError, match=r"b\.zip/log\.txt: line \d+: 'ACCE;a;b"):
            read(broken)

    def test_a_pause_of_phyphox_moves_all_sensors(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_phyphox(tmp_path, phone_walk)
        with zipfile.ZipFile(path) as archive:
            files: dict[str, Any] = {name: archive.read(name) for name in archive.namelist()}
        files["meta/time.csv"] += b'"PAUSE",10.0,1700000010.0,"a"\n"START",10.0,1700000025.0,"b"\n'
        log = read(zip_of(tmp_path / "b.zip", files))
        assert log.rows["accel"][-1, 0] == pytest.approx(29.99 + 15.0)
        assert [finding.code for finding in log.findings] == ["gap", "gap"]

    def test_only_quaternions_say_what_is_missing(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(write_dot(tmp_path, phone_walk, free=True))
        assert [finding.code for finding in log.findings] == ["cannot-localize"]
        assert "gyroscope" in log.findings[0].remedy


FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "blank": lambda content: b"\n\n  \n",
    "byte-order mark": lambda content: b"\xef\xbb\xbf" + content,
    "CRLF": lambda content: content.replace(b"\n", b"\r\n"),
    "NUL": lambda content: content[:5000] + b"\0" + content[5000:],
    "not UTF-8": lambda content: content[:5000] + b"\xff\xfe\xfd" + content[5000:],
    "UTF-16": lambda content: content.decode("utf-8", "replace").encode("utf-16"),
    "a line of a megabyte": lambda content: content + b"1" * (1 << 20),
    "truncated": lambda content: content[: len(content) - 7],
    "half": lambda content: content[: len(content) // 2],
    "header only": lambda content: content.partition(b"\n")[0] + b"\n",
    "two headers": lambda content: content.partition(b"\n")[0] + b"\n" + content,
    "not a number": lambda content: content[:6000] + b"\nNaN,NaN;NaN\n" + content[6000:],
    "1e400": lambda content: content.replace(b"9.", b"9e400", 50),
    "text for a number": lambda content: content[: len(content) // 2] + b"zebra" + content[len(content) // 2 :],
    "twice": lambda content: content + content.partition(b"\n")[2],
    "backwards": lambda content: b"\n".join([content.partition(b"\n")[0], *content.splitlines()[:0:-1], b""]),
    "nothing but separators": lambda content: b"PRES;;;;\nPRES;;;\n" * 5000,
    "tags": lambda content: b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>',
}
TEXTS = ("getsensordata", "androsensor", "xio", "xsens dot", "xsens mt", "ridi", "oxiod", "csv", "sensor logger, JSON")


class TestBadInput:
    """Whatever is wrong with a file, there is one error that names it and says what to do, or an account of it."""

    @pytest.mark.parametrize("fault", FAULTS)
    @pytest.mark.parametrize("name", TEXTS)
    def test_a_damaged_text(self, name: str, fault: str, phone_walk: Rows, tmp_path: Path) -> None:
        kind, write, _ = WRITERS[name]
        short = {sensor: rows[:300] for sensor, rows in phone_walk.items()}
        path = write(tmp_path, short)
        whole = read(path, kind, strict=False)
        path.write_bytes(FAULTS[fault](path.read_bytes()))
        try:
            log = read(path, kind, strict=False)
        except RecordingError as error:
            assert str(path) in str(error)
            assert ";" in str(error)
            return
        account = log.report
        changed = sum(account.dropped.values()) + sum(account.mended.values()) + len(log.findings)
        same = {s: len(r) for s, r in log.rows.items()} == {s: len(r) for s, r in whole.rows.items()}
        assert changed or same or fault == "half"

    @pytest.mark.parametrize("fault", ["empty", "half", "NUL", "truncated"])
    @pytest.mark.parametrize("name", ["sensor logger, iOS", "phyphox", "ros 1", "mcap, JSON", "ronin"])
    def test_a_damaged_archive_or_binary(self, name: str, fault: str, phone_walk: Rows, tmp_path: Path) -> None:
        kind, write, _ = WRITERS[name]
        path = write(tmp_path, {sensor: rows[:300] for sensor, rows in phone_walk.items()})
        file = path / "data.hdf5" if path.is_dir() else path
        file.write_bytes(FAULTS[fault](file.read_bytes()))
        try:
            read(path, kind, strict=False)
        except RecordingError as error:
            assert file.name.partition(".")[0] in str(error)
            assert ";" in str(error)

    @pytest.mark.parametrize(
        ("member", "content", "message"),
        [
            ("../a.csv", b"x", "outside the archive"),
            ("/etc/a.csv", b"x", "outside the archive"),
            ("a.csv", b"\0" * (70 << 20), "zip bomb"),
            ("other.zip", b"PK", "holds other archives"),
        ],
    )
    def test_a_malicious_archive(self, member: str, content: bytes, message: str, tmp_path: Path) -> None:
        path = zip_of(tmp_path / "a.zip", {member: content})
        with pytest.raises(RecordingError, match=message):
            detect(path)

    def test_a_link_in_an_archive(self, tmp_path: Path) -> None:
        link = zipfile.ZipInfo("Accelerometer.csv")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
            archive.writestr(link, "/etc/passwd")
        with pytest.raises(RecordingError, match="is a link"):
            detect(tmp_path / "a.zip")

    def test_a_second_phone_in_the_archive(self, phone_walk: Rows, tmp_path: Path) -> None:
        files = {**sensor_logger(phone_walk, apple=True)}
        both = {f"{phone}/{name}": content for phone in ("mine", "yours") for name, content in files.items()}
        with pytest.raises(RecordingError, match=r"mine/\w+.csv and yours/\w+.csv are of two"):
            read(zip_of(tmp_path / "a.zip", both))

    def test_data_outside_an_hdf5_file(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_ronin(tmp_path, phone_walk)
        h5py = pytest.importorskip("h5py")
        with h5py.File(path / "data.hdf5", "a") as file:
            del file["synced/acce"]
            file["synced/acce"] = h5py.ExternalLink("other.hdf5", "/acce")
        with pytest.raises(RecordingError, match="synced/acce is a link"):
            read(path)

    def test_a_timetable_of_matlab_is_refused_with_the_way_out(self, tmp_path: Path) -> None:
        name = b"Acceleration"
        element = b"\x0e\0\0\0" + (88).to_bytes(4, "little") + b"\0" * 24 + name + b"\0" * 12 + b"MCOStimetable"
        (tmp_path / "a.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + element.ljust(200, b"\0"))
        assert detect(tmp_path / "a.mat") == "matlab_mobile"
        with pytest.raises(RecordingError, match="writetable"):
            read(tmp_path / "a.mat")

    def test_units_in_another_scale_are_one_error_or_a_list(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_ridi(tmp_path, {**phone_walk, "accel": phone_walk["accel"] / [1, G, G, G]})
        with pytest.raises(RecordingError, match=r"data.csv: accel: .*looks like g"):
            read(path)
        assert read(path, strict=False).findings[0].code == "accel-unit"

    def test_a_log_of_weeks_is_refused_before_it_is_read(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_getsensordata(tmp_path, phone_walk)
        with path.open("a") as file:
            file.write("ACCE;90000.0;95000.0;0.1;0.2;9.8;3\n")
        with pytest.raises(RecordingError, match="25 h after the first record, expected a walk of at most 24"):
            read(path, strict=False)

    def test_no_option_is_ignored(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_euroc(tmp_path, phone_walk)
        with pytest.raises(RecordingError, match="has no option 'columns'"):
            read(path, columns={"time": "t"})


class TestTables:
    """Tables of numbers with a column map, stated or guessed."""

    MAP = """
        [columns]
        time = "when"
        time_unit = "us"
        accel = ["-c", "a", "b"]
        accel_unit = "g"
        gyro = ["w1", "w2", "w3"]
        gyro_unit = "deg/s"
        place = ["lat", "lon"]
        place_unit = "deg"
        level = "floor"
        mounting = "hand"
    """

    @pytest.fixture
    def table(self, phone_walk: Rows, tmp_path: Path) -> Path:
        t, a = phone_walk["accel"][:, 0], phone_walk["accel"][:, 1:] / G
        w = np.degrees(phone_walk["gyro"][:, 1:])
        values = [np.round(t * 1e6), a[:, 1], a[:, 2], -a[:, 0], w, 49.46 + 1e-6 * t, np.full(len(t), 11.11), t // 10]
        (tmp_path / "columns.toml").write_text(self.MAP)
        return write_table(tmp_path / "a.csv", "when,a,b,c,w1,w2,w3,lat,lon,floor", np.column_stack(values))

    def test_a_stated_map(self, table: Path, phone_walk: Rows) -> None:
        log = read(table, "csv", columns=table.with_name("columns.toml"))
        np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-6)
        np.testing.assert_allclose(log.rows["gyro"], phone_walk["gyro"], atol=1e-6)
        assert (log.mounting, log.findings, np.unique(log.reference.level).tolist()) == ("hand", (), [0, 1, 2])
        assert log.geo is not None

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('gyro_unit = "deg/s"', 'gyro_unit = "rpm"', "Invalid enum value 'rpm'"),
            ("gyro_unit", "gyr_unit", "did you mean 'gyro_unit'"),
            ('"w1"', '"w9"', "no column 'w9'; the header names when, a, b"),
            ('time = "when"', "", "missing required field `time`"),
            ('"deg/s"', '"rad/s"', "looks like degree/s"),
            ("[columns]", "[columns", "not TOML"),
        ],
    )
    def test_a_wrong_map(self, table: Path, old: str, new: str, message: str) -> None:
        table.with_name("columns.toml").write_text(self.MAP.replace(old, new))
        with pytest.raises(RecordingError, match=message):
            read(table, "csv", columns=table.with_name("columns.toml"))

    def test_a_guess_can_be_pasted(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_csv(tmp_path, phone_walk)
        (tmp_path / "columns.toml").write_text(csv_columns.column_map_of(path))
        stated = read(path, "csv", columns=tmp_path / "columns.toml")
        assert stated.findings == ()
        for sensor, rows in read(path).rows.items():
            np.testing.assert_array_equal(stated.rows[sensor], rows)

    def test_units_by_size_are_a_warning(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = write_table(tmp_path / "a.csv", "t,ax,ay,az,gx,gy,gz", table_of(phone_walk, "accel", "gyro"))
        log = read(path)
        assert [finding.code for finding in log.findings] == ["columns-guessed"]
        assert "# by the size" in csv_columns.column_map_of(path)

    @pytest.mark.parametrize(
        ("header", "expected"),
        [
            ("Time (s),Linear Acceleration x (m/s^2),y,z", {}),
            ("timestamp [ns],accel_x [g],accel_y [g],accel_z [g]", {"time_unit": "ns", "accel_unit": "g"}),
            ("t_s,accel_x_mps2,accel_y_mps2,accel_z_mps2", {"time_unit": "s", "accel_unit": "m/s^2"}),
            ("time_ms,gyr_x_dps,gyr_y_dps,gyr_z_dps", {"time_unit": "ms", "gyro_unit": "deg/s"}),
            ("#time,AccX,AccY,AccZ,MagX (uT),MagY (uT),MagZ (uT)", {"mag_unit": "uT"}),
            ("loggingTime,foo,bar,baz", {}),
        ],
    )
    def test_names_of_columns(self, header: str, expected: dict[str, str], tmp_path: Path) -> None:
        width = header.count(",")
        rows = "\n".join(f"{k}" + ",1.0" * width for k in range(30))
        path = tmp_path / "a.csv"
        path.write_text(f"{header}\n{rows}\n")
        found = csv_columns.column_map_of(path)
        assert bool(found) is bool(expected)
        for name, unit in expected.items():
            assert f'{name} = "{unit}"' in found

    @given(
        values=st.lists(
            st.tuples(*[st.floats(-400.0, 400.0, allow_subnormal=False)] * 3, *[st.floats(-60.0, 60.0)] * 3),
            min_size=2,
            max_size=30,
        ),
        separator=st.sampled_from(",;\t"),
        gzipped=st.booleans(),
    )
    @settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    def test_round_trip_keeps_every_bit(
        self, tmp_path: Path, values: list[tuple[float, ...]], separator: str, gzipped: bool
    ) -> None:
        header = separator.join(
            ["t_s", *(f"{s}_{a}_{u}" for s, u in (("accel", "mps2"), ("gyro", "radps")) for a in XYZ)]
        )
        rows = [separator.join(map(repr, (0.01 * k, *row))) for k, row in enumerate(values)]
        content = "\n".join([header, *rows, ""]).encode()
        path = tmp_path / "a.csv"
        path.write_bytes(gzip.compress(content) if gzipped else content)
        log = read(path, "csv", strict=False)
        np.testing.assert_array_equal(log.rows["accel"][:, 1:], np.array(values)[:, :3])
        np.testing.assert_array_equal(log.rows["gyro"][:, 1:], np.array(values)[:, 3:])


@given(value=st.floats(-1e12, 1e12), digits=st.integers(1, 15))
@settings(max_examples=300, deadline=None)
def test_numbers_of_logs_are_read_to_the_last_bit(value: float, digits: int) -> None:
    written = f"{value:.{digits}g}"
    begin = b"ACCE;" + b";".join([written.encode()] * 5) + b";3\n"
    parts = getsensordata._Parts()
    space = getsensordata._Workspace.of(len(begin))
    getsensordata._read_chunk(Path("a"), begin, 1, parts, getsensordata.Tally(), space, is_last=False)
    got = parts.rows["accel"][0][0, 2]
    assert got == pytest.approx(float(written), rel=4e-16, abs=1e-30)


def test_a_column_map_knows_every_key_that_it_prints() -> None:
    full = read_column_map({"time": "t", "accel": ["a", "b", "c"], "baro": "p", "surveyed": False, "mounting": "hand"})
    import tomllib

    assert read_column_map(tomllib.loads(full.toml())["columns"]) == full


@pytest.mark.parametrize(
    ("pattern", "kind", "sensors", "codes"),
    [
        ("sensor_logger/*.zip", "sensor_logger", "accel gyro", set()),
        ("sensor_logger/simorxb_uncalibrated", "sensor_logger", "accel gyro mag", {"platform", "mag-uncalibrated"}),
        ("xsens_dot/LF*.csv", "xsens", "accel rotation", {"lost-packets", "cannot-localize"}),
        ("xsens_mt/*.txt", "xsens", "accel rotation", {"cannot-localize"}),
        ("ros1_bag/test2.bag", "ros", "accel gyro rotation", {"clock", "reference"}),
        ("ros2_converted/test2_imu_db3", "ros", "accel gyro rotation", {"clock"}),
        (
            "../ipin2023_track3/logs/*21_repetition01.txt",
            "getsensordata",
            "accel gyro mag baro rotation wifi ble",
            set(),
        ),
    ],
)
def test_real_files(data_root: Path, pattern: str, kind: str, sensors: str, codes: set[str]) -> None:
    if kind == "ros":
        pytest.importorskip("rosbags", reason="pip install pdrbench[formats]")
    (path,) = sorted((data_root / "samples").glob(pattern))
    assert detect(path) == kind
    log = READERS[kind].read(path)
    assert set(log.rows) == set(sensors.split())
    assert {finding.code for finding in log.findings} == codes
    force = np.linalg.norm(log.rows["accel"][:, 1:], axis=1)
    assert np.median(force) == pytest.approx(9.8, abs=0.9)
