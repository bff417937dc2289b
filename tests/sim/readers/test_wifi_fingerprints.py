from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from pdrbench.errors import RecordingError
from pdrbench_formats.recordings.matfile import load
from pdrbench_sim.readers.wifi_fingerprints import read

Database = dict[str, Any]


@pytest.fixture
def database() -> Database:
    return {
        "trainingMacs": np.array([[-50, 100, -70], [100, 100, 100], [0, -104, -90]], dtype=np.int16),
        "testMacs": np.array([[100, -60, 100]], dtype=np.int16),
        "trainingLabels": np.array([[1.0, 2, 0, 0, 0], [4, 6, 3.7, 1, 0], [1, 6, 3.7, 1, 2]]),
        "testLabels": np.array([[1.5, 2.5, 7.4, 2, 1]]),
    }


def put(folder: Path, database: Database, *, compress: bool = True) -> Path:
    path = folder / "set.mat"
    savemat(path, {"other": np.arange(3.0), "database": database}, do_compression=compress)
    return path


@pytest.mark.parametrize("compress", [False, True])
def test_a_set_reads_as_it_was_written(tmp_path: Path, database: Database, compress: bool) -> None:
    found = read(put(tmp_path, database, compress=compress))
    n = np.nan
    np.testing.assert_array_equal(found.train.rssi_dbm, [[-50, n, -70], [n, n, n], [0, -104, -90]])
    np.testing.assert_array_equal(found.test.rssi_dbm, [[n, -60, n]])
    assert found.train.xy_m.tolist() == [[1, 2], [4, 6], [1, 6]]
    assert found.train.level.tolist() == [0, 1, 1]
    assert found.train.building.tolist() == [0, 0, 2]
    assert (found.test.height_m.tolist(), found.test.level.tolist(), found.test.building.tolist()) == ([7.4], [2], [1])
    assert found.ground_scale == 1.0


def test_web_mercator_becomes_metres_on_the_ground(tmp_path: Path, database: Database) -> None:
    """A degree of longitude on the parallel of 60 degrees is half as long as Web Mercator has it."""
    north_m = 6_378_137.0 * math.log(math.tan(math.radians(45 + 60 / 2)))
    for part in ("training", "test"):
        database[f"{part}Labels"][:, :2] += [1_500_000.0, north_m]
    found = read(put(tmp_path, database))
    assert found.ground_scale == pytest.approx(0.5, rel=1e-5)  # the places lie 6 m north of it
    np.testing.assert_allclose(found.train.xy_m, [[0, 0], [1.5, 2], [0, 2]], atol=1e-4)
    np.testing.assert_allclose(found.test.xy_m, [[0.25, 0.25]], atol=1e-4)


def test_a_survey_holds_what_was_received(tmp_path: Path, database: Database) -> None:
    survey = read(put(tmp_path, database)).train.radio_map()
    assert survey.first.tolist() == [0, 2, 2, 5]
    assert survey.access_point.tolist() == [0, 2, 0, 1, 2]
    assert survey.rssi_dbm.tolist() == [-50, -70, 0, -104, -90]
    assert survey.surveyed


def drop(name: str) -> Callable[[Database], object]:
    return lambda database: database.pop(name)


def put_in(name: str, row: int, column: int, value: float) -> Callable[[Database], object]:
    def change(database: Database) -> None:
        database[name] = database[name].astype(float)
        database[name][row, column] = value

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (drop("testMacs"), "no variable 'database.testMacs'"),
        (lambda d: d.update(testMacs=d["testMacs"][:, :2]), "has 2 access points and trainingMacs has 3"),
        (lambda d: d.update(trainingMacs=d["trainingMacs"][:2]), "has 2 rows and the labels have 3"),
        (lambda d: d.update(trainingLabels=d["trainingLabels"][:, :4]), r"expected \(N, 5\)"),
        (lambda d: d.update(trainingMacs=np.zeros((0, 3))), r"expected \(N, A\)"),
        (lambda d: d.update(trainingMacs="text"), "is no array of real numbers"),
        (put_in("testMacs", 0, 0, 99.0), "row 1 has an RSSI above 0 dBm"),
        (put_in("testMacs", 0, 0, -np.inf), "row 1 has an RSSI above 0 dBm or an infinite one"),
        (put_in("trainingLabels", 1, 0, np.nan), "row 2 is not x, y, z, level and building"),
        (put_in("trainingLabels", 2, 3, 1.5), "row 3 is not x, y, z, level and building"),
    ],
)
def test_a_set_that_cannot_be_right_is_refused(
    tmp_path: Path, database: Database, change: Callable[[Database], object], says: str
) -> None:
    change(database)
    with pytest.raises(RecordingError, match=says) as refused:
        read(put(tmp_path, database))
    assert "set.mat" in str(refused.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "set.mat"
    savemat(path, {"database": np.ones((2, 2))})
    with pytest.raises(RecordingError, match=r"no variable 'database\.trainingMacs'"):
        read(path)
    savemat(path, {"database": np.zeros((1, 2), dtype=[("trainingMacs", "O")])})
    with pytest.raises(RecordingError, match="array of structures"):
        read(path)


def test_fields_of_structures_read_as_scipy_reads_them(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "set.mat"
    inside = {"a": rng.random((3, 2)), "deep": {"a": 1.0}, "a_long_name_of_a_field": np.arange(4)}
    savemat(path, {"a": 7.0, "s": inside})
    found = load(path, ("a", "s.a", "s.a_long_name_of_a_field"))
    expected = loadmat(path, simplify_cells=True)["s"]
    assert found.vector("a", 1) == [7.0]
    np.testing.assert_array_equal(found.matrix("s.a"), expected["a"])
    np.testing.assert_array_equal(found.vector("s.a_long_name_of_a_field"), expected["a_long_name_of_a_field"])
    with pytest.raises(RecordingError, match="no array of real numbers"):
        load(path, ("s.deep",))


@pytest.mark.data
def test_the_published_sets_have_their_known_facts(data_root: Path) -> None:
    folder = data_root / "wifi_fingerprints"
    if not folder.is_dir():
        pytest.skip("no wifi_fingerprints/ in PDRBENCH_DATA")
    uji, library = read(folder / "UJI1.mat"), read(folder / "LIB1.mat")
    assert (len(uji.train), len(uji.test), uji.train.rssi_dbm.shape[1]) == (19861, 1111, 520)
    assert uji.ground_scale == pytest.approx(math.cos(math.radians(39.99)), abs=2e-4)  # Castellon
    assert np.ptp(uji.train.xy_m, axis=0) == pytest.approx([299.2, 207.6], abs=0.1)
    assert np.nanmin(uji.train.rssi_dbm) == -104
    assert sorted(set(library.train.level)) == [3, 5]
    assert library.ground_scale == 1.0
