"""Walks of RoNIN, RIDI and OxIOD: who walked, which part they belong to, and the frame of their places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recording_samples as samples

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench_baselines.learned.signals import turned
from pdrbench_lab.learned.people import train_bearer
from pdrbench_lab.learned.public_sets import in_phone_frame, load, public_walks, recordings_of

TURN_RAD = 1.1


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two made-up walks of each of RIDI and OxIOD, and one of RoNIN, as the sets lay them out."""
    pytest.importorskip("h5py", reason="RoNIN is HDF5")
    root, walk = tmp_path_factory.mktemp("public"), samples.make_walk()
    for name in ("ronin", "ridi/dan_bag1", "ridi/hao_leg2", "oxiod/handheld/data1/syn", "oxiod/trolley/data2/syn"):
        (root / name).mkdir(parents=True)
        write = {"ronin": samples.ronin, "ridi": samples.ridi, "oxiod": samples.oxiod}[name.partition("/")[0]]
        write(root / name, walk)
    (root / "ronin" / "list_test_unseen.txt").write_text("# walks\na000_1\n../../etc\n")
    (root / "ridi" / "list_train_publish_v2.txt").write_text("dan_bag1,bag\nhao_leg2,leg\n")
    (root / "oxiod" / "handheld" / "Train.txt").write_text("data1/syn/imu1.csv\n")
    (root / "oxiod" / "trolley" / "Test.txt").write_text("data2/syn/imu1.csv\n")
    return root


def test_people_places_and_parts_of_walks(folder: Path) -> None:
    found = {walk.name: (walk.form, walk.person, walk.carried, walk.part) for walk in public_walks(folder)}
    assert found == {
        "oxiod/handheld/data1/syn/imu1.csv": ("oxiod", "handheld/data1", "handheld", "train"),
        "oxiod/trolley/data2/syn/imu1.csv": ("oxiod", "trolley/data2", "trolley", "test"),
        "ridi/dan_bag1": ("ridi", "dan", "bag", "train"),
        "ridi/hao_leg2": ("ridi", "hao", "leg", "train"),
        "ronin/a000_1": ("ronin", "a000", "", "test"),
    }


def test_without_lists_a_person_is_in_one_part(folder: Path, tmp_path: Path) -> None:
    for number in range(40):
        for walk in (1, 2):
            (tmp_path / f"p{number}_{walk}").mkdir()
            (tmp_path / f"p{number}_{walk}" / "data.hdf5").touch()
    part = {(walk.person, walk.part) for walk in public_walks(tmp_path)}
    assert len(part) == 40
    assert 2 <= sum(name == "test" for _, name in part) <= 16  # of 40 at 0.2: within 2.4 standard deviations


def test_every_walk_has_an_attitude_and_places(folder: Path) -> None:
    loaded = [load(walk) for walk in public_walks(folder)]
    for one in loaded:
        assert set(one.streams) == {"accel", "gyro", "rotation"}
        length_m = np.hypot(*np.diff(one.reference.xy_m, axis=0).T).sum()
        span_s = one.reference.t_s[-1] - one.reference.t_s[0]
        assert length_m == pytest.approx(np.hypot(1, 2) * span_s, rel=0.01) or length_m == pytest.approx(
            2 * span_s, rel=0.01
        )  # the samples walk along a line at 2 m/s, some along (1, 2)
    assert [one.mounting for one in loaded] == ["hand", "hand", "hand", "pocket", "hand"]
    assert len(list(recordings_of(folder, "train"))) == 3


def test_a_walk_without_places_is_refused(tmp_path: Path) -> None:
    (tmp_path / "data1").mkdir()
    samples.oxiod(tmp_path / "data1", samples.make_walk())
    (tmp_path / "data1" / "vi1.csv").unlink()
    with pytest.raises(DatasetError, match="no places"):
        load(public_walks(tmp_path)[0])


@pytest.mark.parametrize("number", [1, 2])  # in the hand, in a pocket
def test_places_are_turned_into_the_frame_of_the_attitude(number: int) -> None:
    walk = train_bearer(number)
    rows = [walk.streams[name].rows for name in ("accel", "gyro", "rotation")]
    other = replace(walk.reference, xy_m=turned(walk.reference.xy_m, TURN_RAD), heading_rad=None)
    found, same = in_phone_frame(other, *rows), in_phone_frame(walk.reference, *rows)
    np.testing.assert_allclose(found.xy_m, same.xy_m, atol=1e-6)  # whatever the angle between the frames was
    off_rad = _turn_rad(walk.reference.xy_m, found.xy_m)
    assert abs(off_rad) < np.radians(15.0)  # a compass is off by 11 degrees (sources.md 1.5)


def _turn_rad(one_m: FloatArray, other_m: FloatArray) -> float:
    moves = [np.diff(xy_m[:, 0]) + 1j * np.diff(xy_m[:, 1]) for xy_m in (one_m, other_m)]
    return float(wrap_rad(np.angle(np.sum(moves[1] * np.conj(moves[0])))))
