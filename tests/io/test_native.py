"""The project's own storage of recordings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import RecordingError
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings import native


def room() -> Building:
    square = np.array([[0.0, 0.0], [4.1, 0.0], [4.1, 3.3], [0.0, 3.3]])
    return Building("house", (FloorPolygon("room", square, np.full(4, WALL), 0.0, 0),))


def make(rng: np.random.Generator, *, building: bool = True, full: bool = True) -> Recording:
    t_s = np.sort(rng.uniform(0, 60, 500))
    accel = np.column_stack([t_s, rng.normal(0, 5, (500, 3))])
    reference = Trajectory(
        t_s=np.array([0.0, 1 / 3, 2.0]),
        xy_m=rng.normal(size=(3, 2)),
        level=np.array([0, 1, -2]),
        surveyed=np.array([True, False, True]),
        heading_rad=rng.normal(size=3) if full else None,
        z_m=rng.normal(size=3) if full else None,
    )
    return Recording(
        id="walk 7 / ß",
        building=room() if building else None,
        streams={
            "accel": SensorStream(sensor_spec("accel"), accel),
            "wifi": SensorStream(sensor_spec("wifi"), np.zeros((0, 5))),
        },
        reference=reference,
        subject={"height_m": 1.7300000000000002, "name": "A"},
        device="phone",
        mounting="hand",
    )


def assert_equal(one: Recording, other: Recording) -> None:
    for field in ("id", "building", "device", "mounting"):
        assert getattr(one, field) == getattr(other, field)
    assert dict(one.subject) == dict(other.subject)
    assert list(one.streams) == list(other.streams)
    for name, stream in one.streams.items():
        np.testing.assert_array_equal(stream.rows, other.streams[name].rows)
        for field in ("name", "columns", "rate_hz", "what"):
            assert getattr(stream.spec, field) == getattr(other.streams[name].spec, field)
        np.testing.assert_array_equal(stream.spec.low, other.streams[name].spec.low)
        np.testing.assert_array_equal(stream.spec.high, other.streams[name].spec.high)
    for field in ("t_s", "xy_m", "level", "surveyed", "heading_rad", "z_m"):
        mine, others = getattr(one.reference, field), getattr(other.reference, field)
        assert (mine is None) == (others is None)
        if mine is not None:
            np.testing.assert_array_equal(mine, others)
            assert mine.dtype == others.dtype


@pytest.mark.parametrize("building", [True, False])
@pytest.mark.parametrize("full", [True, False])
def test_round_trip_is_exact(tmp_path: Path, rng: np.random.Generator, building: bool, full: bool) -> None:
    recording = make(rng, building=building, full=full)
    native.write(recording, tmp_path / "deep" / "walk")
    assert_equal(recording, native.read(tmp_path / "deep" / "walk"))
    assert [place.name for place in (tmp_path / "deep").iterdir()] == ["walk"]  # nothing left behind


def test_rows_stay_on_disk_and_cannot_be_changed(tmp_path: Path, rng: np.random.Generator) -> None:
    native.write(make(rng), tmp_path / "walk")
    rows = native.read(tmp_path / "walk").streams["accel"].rows
    base = rows
    while not isinstance(base, np.memmap) and isinstance(base.base, np.ndarray):
        base = base.base
    assert isinstance(base, np.memmap)
    assert not rows.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        rows[0, 0] = 1.0


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-8])


def _swap(path: Path) -> None:
    np.save(path, np.zeros((2, 4)))


def _pickle(path: Path) -> None:
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)


@pytest.mark.parametrize("harm", [Path.unlink, _cut, _swap, _pickle, lambda path: path.write_bytes(b"")])
@pytest.mark.parametrize("name", ["stream.accel.npy", "reference.xy_m.npy"])
def test_a_torn_array_is_named(tmp_path: Path, rng: np.random.Generator, harm: object, name: str) -> None:
    native.write(make(rng), tmp_path / "walk")
    harm(tmp_path / "walk" / name)  # type: ignore[operator]
    with pytest.raises(RecordingError, match=name.replace(".", r"\.")):
        native.read(tmp_path / "walk")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "other"}, "format 'other' version 1"),
        ({"version": 2}, "version 2, expected 'pdrbench-recording' version 1"),
        ({"id": 3}, "Expected `str`"),
        ({"extra": 3}, "unknown field"),
        ({"arrays": {"../../etc/passwd": {"shape": [1], "dtype": "<f8"}}}, "no array is named"),
        ({"arrays": {}}, "an array is missing"),
    ],
)
def test_a_foreign_index_is_refused(tmp_path: Path, rng: np.random.Generator, change: object, says: str) -> None:
    native.write(make(rng), tmp_path / "walk")
    path = tmp_path / "walk" / "recording.json"
    index = json.loads(path.read_bytes())
    path.write_text(json.dumps(index | change))
    with pytest.raises(RecordingError, match=f"recording.json.*{says}"):
        native.read(tmp_path / "walk")


def test_a_torn_index_and_a_missing_building_are_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    native.write(make(rng), tmp_path / "walk")
    (tmp_path / "walk" / "building.geojson").unlink()
    with pytest.raises(RecordingError, match="building"):
        native.read(tmp_path / "walk")
    _cut(tmp_path / "walk" / "recording.json")
    with pytest.raises(RecordingError, match="torn or foreign"):
        native.read(tmp_path / "walk")
    with pytest.raises(RecordingError, match="expected a folder that pdrbench wrote"):
        native.read(tmp_path)
