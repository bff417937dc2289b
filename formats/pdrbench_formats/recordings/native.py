"""Recordings in the project's own storage: a folder with one `.npy` per array and JSON for the rest.

    recording.json            names, specs, subject, and shape and type of every array; written last
    stream.<sensor>.npy       (T, C) rows
    reference.<field>.npy     one array of the reference
    building.geojson          where there is a building

Arrays are mapped into memory, not read, and reach the recording without a copy. Round trips are exact. Nothing in such
a folder is ever unpickled.

App: pdrbench.
Files: A folder that `pdrbench convert` wrote.
Sensors: Any, with the reference and the building.
Units: Those of pdrbench.
Clock: Seconds from the start of the walk.
Traps: A folder without `recording.json` was not written to its end.
"""

from __future__ import annotations

import contextlib
import math
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import MapError, RecordingError
from pdrbench.files import sync
from pdrbench.io.reader import Reader
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.trajectory import Trajectory
from pdrbench_formats.maps import geojson

FORMAT, VERSION = "pdrbench-recording", 1
INDEX, BUILDING = "recording.json", "building.geojson"
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")
_MAX_INDEX_BYTES: Final = 1 << 20


class _Array(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an array file must hold."""

    shape: tuple[int, ...]
    dtype: str


class _Index(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of `recording.json`."""

    format: str
    version: int
    id: str
    device: str
    mounting: str
    subject: dict[str, float | str]
    has_building: bool
    sensors: tuple[SensorSpec, ...]
    arrays: dict[str, _Array]


def write(recording: Recording, folder: Path | str) -> None:
    """Writes a recording into a new folder, whole or not at all.

    Raises:
        RecordingError: The folder exists, or something in the recording cannot be stored.
    """
    folder = Path(folder)
    if folder.exists():
        raise RecordingError(f"{folder} exists; choose another folder or delete it")
    arrays = _arrays(recording)
    index = _Index(
        format=FORMAT,
        version=VERSION,
        id=recording.id,
        device=recording.device,
        mounting=recording.mounting,
        subject=dict(recording.subject),
        has_building=recording.building is not None,
        sensors=tuple(stream.spec for stream in recording.streams.values()),
        arrays={name: _Array(values.shape, values.dtype.str) for name, values in arrays.items()},
    )
    with new_folder(folder) as scratch:
        for name, values in arrays.items():
            np.save(scratch / f"{name}.npy", values, allow_pickle=False)
        if recording.building is not None:
            geojson.write(recording.building, scratch / BUILDING)
        (scratch / INDEX).write_bytes(msgspec.json.format(msgspec.json.encode(index, enc_hook=np.ndarray.tolist)))


@contextlib.contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder to be filled, which has its name once it is whole and on the disk; nothing is left of one that fails."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        yield scratch
        for place in scratch.iterdir():
            sync(place)
        scratch.chmod(0o755)
        scratch.rename(folder)
    except BaseException:
        shutil.rmtree(scratch, ignore_errors=True)
        raise
    sync(folder.parent)


def read(folder: Path | str) -> Recording:
    """Reads a recording; its arrays stay on disk until they are used.

    Raises:
        RecordingError: Names the file that is missing, torn or foreign.
    """
    folder = Path(folder)
    index = _read_index(folder / INDEX)
    arrays = {name: _read_array(folder, name, expected) for name, expected in index.arrays.items()}
    reference = {name.partition(".")[2]: a for name, a in arrays.items() if name.startswith("reference.")}
    try:
        return Recording(
            id=index.id,
            building=geojson.read(folder / BUILDING) if index.has_building else None,
            streams={spec.name: SensorStream(spec, arrays[f"stream.{spec.name}"]) for spec in index.sensors},
            reference=Trajectory(**reference),
            subject=index.subject,
            device=index.device,
            mounting=index.mounting,
        )
    except (KeyError, TypeError) as error:
        raise RecordingError(f"{folder / INDEX}: an array is missing ({error}); write the recording again") from error
    except (RecordingError, MapError) as error:
        raise RecordingError(f"{folder}: {error}") from error


def _arrays(recording: Recording) -> dict[str, NDArray[Any]]:
    """Every array of a recording by the stem of its file; refuses what cannot be stored."""
    for key, fact in recording.subject.items():
        if not isinstance(fact, str) and not math.isfinite(fact):
            raise RecordingError(f"recording {recording.id!r}: subject fact {key!r} is {fact}; leave it out")
    for name in recording.streams:
        if not _NAME.fullmatch(name):
            raise RecordingError(f"a sensor named {name!r} cannot be stored; use lower-case letters, digits and _")
    arrays: dict[str, NDArray[Any]] = {f"stream.{name}": stream.rows for name, stream in recording.streams.items()}
    for field in ("t_s", "xy_m", "level", "surveyed", "heading_rad", "z_m"):
        values = getattr(recording.reference, field)
        if values is not None:
            arrays[f"reference.{field}"] = values
    return arrays


def _read_index(path: Path) -> _Index:
    try:
        with path.open("rb") as stream:
            content = stream.read(_MAX_INDEX_BYTES)
        index = msgspec.json.decode(content, type=_Index, dec_hook=lambda _, numbers: np.array(numbers))
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read: {error.strerror}; expected a folder that pdrbench wrote a recording into"
        ) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecordingError) as error:
        raise RecordingError(f"{path}: {error}; the file is torn or foreign: write the recording again") from error
    if (index.format, index.version) != (FORMAT, VERSION):
        raise RecordingError(
            f"{path}: format {index.format!r} version {index.version}, expected {FORMAT!r} version {VERSION}; "
            f"read it with the pdrbench that wrote it"
        )
    return index


def _read_array(folder: Path, name: str, expected: _Array) -> NDArray[Any]:
    """Maps an array file; the mapping is read-only."""
    room, _, what = name.partition(".")
    if room not in ("stream", "reference") or not _NAME.fullmatch(what):
        raise RecordingError(f"{folder / INDEX}: no array is named {name!r}; write the recording again")
    path = folder / f"{name}.npy"
    try:
        # an empty array has nothing to map
        values = np.load(path, mmap_mode="r" if math.prod(expected.shape) else None, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise RecordingError(f"{path}: missing or torn ({error}); write the recording again") from error
    if not isinstance(values, np.ndarray) or (values.shape, values.dtype.str) != (expected.shape, expected.dtype):
        raise RecordingError(f"{path}: not the array that {INDEX} describes; write the recording again")
    return np.asarray(values)


READER: Final = Reader(read, lambda head: (head.path / INDEX).is_file())
