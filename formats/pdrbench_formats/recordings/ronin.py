"""RoNIN, a set of phone walks with a Tango phone on the body as reference (Herath, Yan, Furukawa 2020).

App: the recorder of the set (Android); needs the extra `formats`.
Files: the folder of a walk with `data.hdf5` and `info.json`, or that HDF5 file.
Sensors: accel, gyro, mag, rotation, baro where it was recorded; positions of the Tango as the reference, one level.
Units: m/s², rad/s, µT, hPa, m.
Frame: of Android; the attitude is `rv`, else `game_rv`, whose heading is arbitrary: never the one that the set chose by
its error against the reference.
Clock: `synced/time`, seconds.
Traps: quaternions are w, x, y, z; the calibration in `info.json` is applied: gyro minus its bias at the start,
acceleration times scale after its bias; the reference is of another device, begins at `start_frame`, and its frame is
turned against east.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import MAX_RATIO, MIN_BOMB_BYTES, refuse_compressed
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, places, unit_quaternions
from pdrbench_formats.recordings.attitude import device_to_building

HDF5: Final = b"\x89HDF\r\n\x1a\n"
DATA, INFO = "data.hdf5", "info.json"
MAX_ROWS: Final = 50_000_000
_MAX_INFO_BYTES: Final = 1 << 20


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one walk.

    Raises:
        RecordingError: Names file, array and remedy.
    """
    path, tally = Path(path), Tally()
    file = path / DATA if path.is_dir() else path
    refuse_compressed(file)
    arrays = _arrays(file)
    info = _info(file.with_name(INFO), tally)
    t_s = arrays["time"].ravel()
    streams: dict[str, FloatArray] = {}
    if "acce" in arrays:
        force = np.array(info.imu_acce_scale) * (arrays["acce"] - info.imu_acce_bias)
        streams["accel"] = np.column_stack([t_s, force])
    gyro = arrays.get("gyro_uncalib")
    if gyro is not None:
        streams["gyro"] = np.column_stack([t_s, gyro - info.imu_init_gyro_bias])
    elif "gyro" in arrays:
        streams["gyro"] = np.column_stack([t_s, arrays["gyro"]])
    if "magnet" in arrays:
        streams["mag"] = np.column_stack([t_s, arrays["magnet"]])
    source = next((name for name in ("rv", "game_rv") if name in arrays), None)
    if source is not None and "accel" in streams:
        q = device_to_building(t_s, unit_quaternions(arrays[source]), t_s, streams["accel"][:, 1:])
        if q is None:
            tally.skipped[f"{source} (does not turn gravity up)"] += len(t_s)
        else:
            streams["rotation"] = np.column_stack([t_s, q])
            if source == "game_rv":
                tally.found("heading", "rotation", "game_rv turns about an arbitrary heading")
    return assemble(
        path,
        streams,
        reference=_reference(arrays, t_s, info, tally),
        origin=Origin(device=info.device),
        tally=tally,
        strict=strict,
    )


def _arrays(file: Path) -> dict[str, FloatArray]:
    """The arrays of `synced` and the positions, with as many rows as there are times."""
    try:
        import h5py
    except ImportError as error:
        raise RecordingError(f"{file}: HDF5 files need h5py: pip install pdrbench[formats]") from error
    arrays: dict[str, FloatArray] = {}
    try:
        left = max(MIN_BOMB_BYTES, MAX_RATIO * file.stat().st_size)
        with h5py.File(file, "r", locking=False) as content:
            for group, names in (
                ("synced", ("time", "acce", "gyro_uncalib", "gyro", "magnet", "rv", "game_rv")),
                ("pose", ("tango_pos",)),
            ):
                for name in names:
                    link = content.get(f"{group}/{name}", getlink=True) if group in content else None
                    if link is None:
                        continue
                    if not isinstance(link, h5py.HardLink) or not isinstance(
                        content.get(group, getlink=True), h5py.HardLink
                    ):
                        raise RecordingError(f"{file}: {group}/{name} is a link; copy the data into the file")
                    dataset = content[f"{group}/{name}"]
                    if not isinstance(dataset, h5py.Dataset) or dataset.external or dataset.is_virtual:
                        raise RecordingError(f"{file}: {group}/{name} lies outside the file; copy the data into it")
                    left -= 8 * dataset.size
                    if dataset.dtype.kind not in "fiu" or dataset.size > 4 * MAX_ROWS or left < 0:
                        raise RecordingError(
                            f"{file}: {group}/{name} has type {dataset.dtype} and shape {dataset.shape}; "
                            f"expected numbers of one walk"
                        )
                    arrays[name] = np.asarray(dataset[()], dtype=np.float64)
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise RecordingError(f"{file}: cannot be read: {str(error)[:200]}; copy the file again") from error
    widths = {"time": 1, "rv": 4, "game_rv": 4}
    if "time" not in arrays:
        raise RecordingError(f"{file}: no array synced/time; is it a walk of RoNIN?")
    for name, values in arrays.items():
        width = widths.get(name, 3)
        if values.size != arrays["time"].size * width:
            raise RecordingError(
                f"{file}: {name} has shape {values.shape}, expected ({arrays['time'].size}, {width}); "
                f"copy the file again"
            )
        arrays[name] = values.reshape(-1, width)
    return arrays


class _Info(msgspec.Struct):
    """What is read of `info.json`."""

    imu_acce_scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    imu_acce_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu_init_gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start_frame: int = 0
    device: str = ""


def _info(file: Path, tally: Tally) -> _Info:
    if not file.is_file():
        tally.note("warning", "calibration", INFO, "missing", "copy it beside data.hdf5: it holds the calibration")
        return _Info()
    try:
        return msgspec.json.decode(file.read_bytes()[:_MAX_INFO_BYTES], type=_Info)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"{file}: no calibration of RoNIN: {error}; copy the file again") from error


def _reference(arrays: dict[str, FloatArray], t_s: FloatArray, info: _Info, tally: Tally) -> Trajectory | None:
    if "tango_pos" not in arrays:
        return None
    begin = info.start_frame if 0 <= info.start_frame < len(t_s) else 0
    xyz = arrays["tango_pos"][begin:]
    return places(t_s[begin:], xyz[:, :2], z_m=xyz[:, 2], tally=tally)


def sniff(head: Head) -> bool:
    """True for a walk of this set."""
    if head.path.is_dir():
        return (head.path / DATA).is_file()
    return head.content.startswith(HDF5) and b"synced" in head.content


READER: Final = Reader(read, sniff, options=("strict",))
