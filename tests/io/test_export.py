"""Trajectories in the formats of other programs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.io.geo import GeoFrame
from pdrbench.trajectory import Estimates, Trajectory
from pdrbench_formats.export import FORMATS, write_path

GEO = GeoFrame(49.46, 11.11)
NAN = np.nan


@pytest.fixture
def track() -> Estimates:
    """Two answers on level 0, one that is missing, two on level 1."""
    xy_m = np.array([[0.1, 0.2], [1 / 3, 4.0], [NAN, NAN], [5.0, 6.0], [7.0, 8.0]])
    level = np.array([0.0, 0.0, NAN, 1.0, 1.0])
    nothing = np.full(5, NAN)
    return Estimates(np.arange(5) / 3, xy_m, level, np.array([0.0, np.pi / 2, NAN, NAN, NAN]), nothing, nothing)


def test_tracks_are_written_as_csv_tum_and_geojson(track: Estimates, tmp_path: Path) -> None:
    write_path(tmp_path / "a.csv", track)
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t_s"]) for row in rows] == track.t_s.tolist()
    assert [float(row["x_m"]) for row in rows if row["x_m"]] == track.xy_m[track.given, 0].tolist()
    assert rows[2]["level"] == ""
    write_path(tmp_path / "a.tum", track, start_unix_s=1.7e9)
    rows = np.loadtxt(tmp_path / "a.tum")
    assert rows.shape == (4, 8)
    np.testing.assert_allclose(rows[1], [1.7e9 + 1 / 3, 1 / 3, 4, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)
    write_path(tmp_path / "a.geojson", track, geo=GEO)
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert [feature["properties"]["level"] for feature in features] == [0, 1]
    lon_lat = np.array(features[1]["geometry"]["coordinates"])
    np.testing.assert_allclose(GEO.to_local(lon_lat[:, 1], lon_lat[:, 0]), track.xy_m[3:], atol=1e-3)


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_reference_and_an_empty_track(suffix: str, tmp_path: Path) -> None:
    whole = Trajectory(
        np.array([0.0, 1.0]), np.zeros((2, 2)), np.array([0, 1]), np.ones(2, np.bool_), z_m=np.array([0.0, 3.0])
    )
    for name, reference in (("whole", whole), ("empty", whole.rows(np.zeros(2, np.bool_)))):
        write_path(tmp_path / f"{name}{suffix}", reference, geo=GEO)
        assert (tmp_path / f"{name}{suffix}").is_file()


@pytest.mark.parametrize(
    ("name", "message"), [("a.geojson", "needs the place on Earth"), ("a.kml", "written as .csv, .tum")]
)
def test_what_cannot_be_written(track: Estimates, tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(PdrbenchError, match=message):
        write_path(tmp_path / name, track)
