"""Walks of the public phone sets RoNIN, RIDI and OxIOD in a folder: which there are, who walked, what to train on.

None of these sets comes with pdrbench. Whoever has one trains on it and tests on people of it that were left out:

    python -m pdrbench_lab.learned public FOLDER --out RUN

The part of a walk is that of the lists that come with a set, where they are in the folder. Else all walks of one in
five people are `test`; in OxIOD, most of which one person walked, all walks of one in five folders `data*`.

Places of these sets are in the frame of a Tango device or of motion capture, attitudes in that of the phone. The angle
between the two is in no file. It follows from accelerations, which both have, whatever the phone does on the body.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench.io.log import Log
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.learned.signals import RATE_HZ, grid_signals
from pdrbench_baselines.learned.yaw_stabiliser import YawStabiliser
from pdrbench_formats.derive.attitude import attitude
from pdrbench_formats.recordings import apps, ronin

TRAIN: Final = "train"
TEST: Final = "test"
TEST_FRACTION: Final = 0.2  # of people, where no list says which
# Standard deviations: motion between the two is that of the body, faster is the phone's, slower tilt. Of nine kinds of
# simulated people the accelerations of phone and places then correlate by 0.67 to 0.93, without the second by 0.16.
BAND_S: Final = (0.5, 2.0)
AROUND_S: Final = 30.0  # likewise, of the time over which the angle between the frames is taken to stay
STEADY_M2PS4: Final = 1e-6  # product of accelerations below which who goes straight at one speed shows no angle
# Lists of walks that come with a set, by part; seen: other walks of people who are in `train`.
LISTS: Final = {
    "list_train.txt": TRAIN,
    "list_val.txt": "val",
    "list_test_seen.txt": "seen",
    "list_test_unseen.txt": TEST,
    "list_train_publish_v2.txt": TRAIN,
    "list_test_publish_v2.txt": TEST,
    "Train.txt": TRAIN,
    "Test.txt": TEST,
}
_WORD: Final = re.compile(r"\w[\w./-]*")
_RIDI: Final = re.compile(r"(?P<person>[^_]+)_(?P<carried>[A-Za-z]+)")


@dataclass(frozen=True, slots=True)
class PublicWalk:
    """A walk of a public set.

    Attributes:
        path: What its reader takes.
        form: "ronin", "ridi" or "oxiod".
        name: Its path in the folder.
        person: Who walked; of OxIOD the folder of the session, where no user is named.
        carried: Where the phone was, in the words of the set; empty where it does not say.
        part: "train", "val", "seen" or "test".
    """

    path: Path
    form: str
    name: str
    person: str
    carried: str
    part: str


def stabilised(rotation: FloatArray, gyro: FloatArray) -> FloatArray:
    """(r, 5) rotation vectors of a whole walk with a steady yaw; see `YawStabiliser`."""
    return YawStabiliser().update(rotation, gyro)


def public_walks(folder: Path) -> list[PublicWalk]:
    """Every walk of the three sets below a folder, in the order of their names."""
    found = [(path.parent, "ronin") for path in folder.rglob(ronin.DATA)]
    found += [(path.parent.parent, "ridi") for path in folder.rglob("processed/data.csv")]
    found += [(path, "oxiod") for path in folder.rglob("imu*.csv") if "raw" not in path.parts]
    listed = {path: part for name, part in LISTS.items() for file in folder.rglob(name) for path in _listed(file)}
    return [_walk(folder, path, form, listed) for path, form in sorted(found)]


def load(walk: PublicWalk) -> Recording:
    """A walk with an attitude, its places turned into the frame of that attitude.

    Raises:
        RecordingError: The file is damaged.
        DatasetError: It lacks a sensor, or has no places.
    """
    log: Log = {"ronin": ronin.read, "ridi": apps.ridi.read, "oxiod": apps.oxiod.read}[walk.form](walk.path)
    rows = dict(log.rows)
    missing = [name for name in ("accel", "gyro") if name not in rows]
    if missing or log.reference is None or len(log.reference) < 2:
        what = f"{', '.join(missing)} is missing" if missing else "it has no places"
        raise DatasetError(f"{walk.path}: {what}; nothing can be learned from it, take it out of the folder")
    if "rotation" not in rows:
        rows["rotation"] = attitude(rows["accel"], rows["gyro"], rows.get("mag"))
    used = {name: rows[name] for name in ("accel", "gyro", "rotation")}
    return Recording(
        id=walk.name,
        building=None,
        streams={name: SensorStream(sensor_spec(name), one) for name, one in used.items()},
        reference=in_phone_frame(log.reference, used["accel"], used["gyro"], used["rotation"]),
        device=log.device,
        mounting="pocket" if "pocket" in walk.carried or "leg" in walk.carried else "hand",
    )


def recordings_of(folder: Path, part: str) -> Iterator[Recording]:
    """The walks of one part, loaded."""
    for walk in public_walks(folder):
        if walk.part == part:
            yield load(walk)


def in_phone_frame(way: Trajectory, accel: np.ndarray, gyro: np.ndarray, rotation: np.ndarray) -> Trajectory:
    """Places turned about the vertical into the frame of an attitude, drift of its yaw and all.

    The angle is that between the accelerations of the places and those of the phone, both in the band `BAND_S`, in
    the mean over half a minute to either side, weighed by their sizes.

    Args:
        way: Places, ten a second or more.
        accel: (k, 4) t_s and specific force.
        gyro: (m, 4) t_s and rates.
        rotation: (r, 5) t_s and attitude wxyz, phone to world.
    """
    from_s = max(float(one[0, 0]) for one in (accel, gyro, rotation))
    till_s = min(float(one[-1, 0]) for one in (accel, gyro, rotation))
    signals = grid_signals(accel, gyro, stabilised(rotation, gyro), from_s, till_s)
    t_s = from_s + np.arange(len(signals)) / RATE_HZ
    place_m = np.interp(t_s, way.t_s, way.xy_m[:, 0]) + 1j * np.interp(t_s, way.t_s, way.xy_m[:, 1])
    true = _in_band(np.gradient(np.gradient(place_m)))
    same = _in_band(signals.accel[:, 0] + 1j * signals.accel[:, 1]) * np.conj(true)
    same[(t_s < way.t_s[0]) | (t_s > way.t_s[-1])] = 0.0
    around = _smooth(same, AROUND_S)
    moves = np.diff(way.xy_m[:, 0]) + 1j * np.diff(way.xy_m[:, 1])
    middle_s = (way.t_s[1:] + way.t_s[:-1]) / 2
    turn = np.interp(middle_s, t_s, around.real) + 1j * np.interp(middle_s, t_s, around.imag)
    size = np.abs(turn)
    unit = np.where(size > STEADY_M2PS4, turn / np.maximum(size, STEADY_M2PS4), 1.0)
    path = np.concatenate([[0.0], np.cumsum(moves * unit)])
    return replace(way, xy_m=np.column_stack([path.real, path.imag]), heading_rad=None)


def _in_band(values: np.ndarray) -> np.ndarray:
    """(n,) without what is faster or slower than `BAND_S`."""
    slow = _smooth(values, BAND_S[0])
    return np.asarray(slow - _smooth(slow, BAND_S[1]))


def _smooth(values: np.ndarray, sigma_s: float) -> np.ndarray:
    """(n,) complex numbers at `RATE_HZ` under a Gaussian."""
    real, imaginary = (gaussian_filter1d(one, sigma_s * RATE_HZ, mode="nearest") for one in (values.real, values.imag))
    return np.asarray(real + 1j * imaginary)


def _walk(folder: Path, path: Path, form: str, listed: dict[Path, str]) -> PublicWalk:
    name = path.relative_to(folder).as_posix()
    if form == "oxiod":
        above = path.parent.parent if path.parent.name == "syn" else path.parent
        person, carried = f"{above.parent.name}/{above.name}", above.parent.name
    elif form == "ridi" and (found := _RIDI.match(path.name)):
        person, carried = found["person"], found["carried"].lower()
    else:
        person, carried = path.name.partition("_")[0], ""
    drawn = int.from_bytes(hashlib.sha256(person.encode()).digest()[:4]) / 2**32
    part = listed.get(path.resolve()) or (TEST if drawn < TEST_FRACTION else TRAIN)
    return PublicWalk(path, form, name, person, carried, part)


def _listed(file: Path) -> Iterator[Path]:
    """Walks that a list names: the first word of each line, a path beside the list or a folder anywhere below it."""
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        word = re.split(r"[,\s]", line.strip())[0]
        if _WORD.fullmatch(word) and ".." not in word:
            beside = file.parent / word
            places = [beside] if beside.exists() else [path for path in file.parent.rglob(word) if path.is_dir()]
            yield from (place.resolve() for place in places)
