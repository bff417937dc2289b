"""Environments on recordings of the foot: replay, briefing, scoring, and no leaks."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pdrbench.datasets import datasets
from pdrbench.errors import DatasetError
from pdrbench.io.log import Log, ReadReport
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs import foot_recordings
from pdrbench_sim.readers import foot_vicon

ENVS = {
    "FootVicon-v1": ("foot_vicon", 42, "LORD MicroStrain 3DM-GX3-25"),
    "FootWalks-v1": ("foot_stride_gcp", 9, "LORD MicroStrain 3DM-GX5-25"),
}


@pytest.fixture
def no_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without the sets, in a process that has not read them before."""
    foot_recordings._log.cache_clear()
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))


@pytest.fixture(params=ENVS)
def env(request: pytest.FixtureRequest, data_root: Path) -> str:
    """Each environment whose registered data is available."""
    name = str(request.param)
    dataset = ENVS[name][0]
    if not (data_root / dataset).is_dir():
        pytest.skip(f"{dataset} is not under PDRBENCH_DATA")
    if make_task(name).note:
        pytest.skip(f"the available {dataset} is not the registered one")
    return name


def reference(t_s: list[float], xy_m: list[list[float]], surveyed: list[bool] | None = None) -> Log:
    count = len(t_s)
    way = Trajectory(
        t_s=np.array(t_s),
        xy_m=np.array(xy_m),
        level=np.zeros(count, dtype=np.int64),
        surveyed=np.array([True] * count if surveyed is None else surveyed),
        z_m=np.arange(count, dtype=np.float64),
    )
    return Log(rows={}, reference=way, device="", report=ReadReport())


def test_motion_capture_is_read_at_observation_times() -> None:
    """A foot at 1 m/s, captured at uneven times, is at k * 0.05 m after k * 0.05 s; heights count from the start."""
    log = reference([0.0, 0.013, 0.081, 0.16, 0.21], [[t, -t] for t in (0.0, 0.013, 0.081, 0.16, 0.21)])
    way = foot_recordings.motion_capture(log)
    np.testing.assert_array_equal(way.t_s, np.arange(5) * 0.05)
    np.testing.assert_allclose(way.xy_m, np.outer(way.t_s, [1, -1]), atol=1e-12)
    np.testing.assert_array_equal(way.surveyed, [False, True, True, True, True])
    assert way.z_m is not None
    assert way.z_m[0] == 0.0 and way.z_m[-1] == pytest.approx(3.8)


def test_nothing_is_scored_beside_a_sample_at_which_the_foot_was_not_seen() -> None:
    times = [0.0, 0.04, 0.06, 0.11, 0.14, 0.16, 0.2]
    log = reference(times, [[t, 0.0] for t in times], [True, True, True, False, True, True, True])
    np.testing.assert_array_equal(foot_recordings.motion_capture(log).surveyed, [False, True, False, True, True])


def test_strides_are_scored_at_the_last_observation_before_the_foot_rises() -> None:
    """Also where a stride falls on an observation, to the rounding; two strides of one period count once."""
    log = reference([0.49, 1.0, 1.7500004, 1.76, 2.049], [[float(k), 0.0] for k in range(5)])
    way = foot_recordings.rests(log)
    np.testing.assert_allclose(way.t_s, [0.45, 1.0, 1.75, 2.0], atol=1e-12)
    np.testing.assert_array_equal(way.xy_m[:, 0], [0, 1, 2, 4])
    np.testing.assert_array_equal(way.surveyed, [False, True, True, True])


def recording_of(way: Trajectory) -> Recording:
    return Recording(id="one", building=None, streams={}, reference=way)


def test_the_briefed_heading_leads_to_where_the_path_is_half_a_metre_away_whatever_the_swing() -> None:
    way = foot_recordings.rests(reference([0.0, 1.0, 2.0, 3.0], [[5, 5], [5.25, 5], [5.25, 6.5], [9, 9]]))
    given_rad = foot_recordings.tell_start(recording_of(way)).heading_rad
    assert given_rad == pytest.approx(np.pi / 3)
    # The foot stands at 0, 0.8 and 1.6 m on the x axis, and swings half a metre to the side in between.
    t_s = np.arange(0.0, 5.0, 0.05)
    phase = np.clip(t_s % 2.0 - 1.0, 0.0, 1.0)
    x_m = 0.8 * (np.floor(t_s / 2.0) + phase)
    y_m = 0.5 * np.sin(np.pi * phase) ** 2
    way = Trajectory(t_s, np.column_stack([x_m, y_m]), np.zeros(len(t_s)), t_s > 0)
    assert foot_recordings.tell_start(recording_of(way)).heading_rad == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("name", ENVS)
def test_a_task_needs_no_data_until_it_loads(no_data: None, name: str) -> None:
    dataset, num_walks, _ = ENVS[name]
    task = make_task(name)
    assert (task.note, task.dataset, task.period_s, task.start) == ("", dataset, 0.05, "pose")
    assert {split: len(walks) for split, walks in task.walks.items()} == {"test": num_walks}
    assert task.default_split == "test"
    with pytest.raises(DatasetError, match=f"{dataset}.*PDRBENCH_DATA"):
        task.load(task.split("test")[0])


@pytest.mark.data
def test_walks_are_whole_and_reveal_nothing(env: str) -> None:
    _, num_walks, device = ENVS[env]
    task = make_task(env)
    assert len(task.split("test")) == num_walks
    for walk in task.split("test")[:4]:
        recording = task.load(walk)
        assert (recording.building, recording.device, recording.mounting) == (None, device, "foot")
        assert set(recording.streams) == {spec.name for spec in task.sensors}
        assert {spec.rate_hz for spec in task.sensors} == {
            stream.spec.rate_hz for stream in recording.streams.values()
        }  # fmt: skip
        accel = recording.streams["accel"]
        assert len(accel.rows) / accel.t_s[-1] == pytest.approx(accel.spec.rate_hz, rel=0.02)
        assert not recording.reference.surveyed[0]
        np.testing.assert_array_equal(recording.reference.level, 0)
        briefing = task.brief(recording)
        assert briefing.start is not None
        np.testing.assert_array_equal(briefing.start.xy_m, recording.reference.xy_m[0])
        assert briefing.start.heading_rad is not None


@pytest.mark.data
def test_the_given_heading_is_the_direction_of_travel(data_root: Path) -> None:
    if not (data_root / "foot_stride_gcp").is_dir():
        pytest.skip("foot_stride_gcp is not under PDRBENCH_DATA")
    task, off_deg = foot_recordings.task_walks(), []
    for walk in task.split("test"):
        recording = task.load(walk)
        start = task.brief(recording).start
        assert start is not None and start.heading_rad is not None
        ahead = recording.reference.xy_m[3] - recording.reference.xy_m[0]
        off_rad = np.angle(np.exp(1j * (np.arctan2(ahead[1], ahead[0]) - start.heading_rad)))
        off_deg.append(abs(np.degrees(off_rad)))
    assert sum(off > 30 for off in off_deg) <= 1  # one walk begins with a turn


@pytest.fixture
def copies(data_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with three of the trials, one under a name that is not registered."""
    trials = sorted((data_root / "foot_vicon" / "data").glob("*.mat"))
    if len(trials) < 3:
        pytest.skip("foot_vicon is not under PDRBENCH_DATA")
    folder = tmp_path / "foot_vicon" / "data"
    folder.mkdir(parents=True)
    for trial in trials[:2]:
        shutil.copy(trial, folder / trial.name)
    shutil.copy(trials[2], folder / "2031-01-01-00-00-00.mat")
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    return folder


@pytest.mark.data
def test_other_walks_are_played_under_a_note(copies: Path, data_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = foot_recordings.task_vicon()
    assert "differs from the registered foot_vicon" in task.note
    assert len(task.split("test")) == 3
    for walk in task.split("test"):
        assert len(task.load(walk).reference) > 100
    (copies / "2031-01-01-00-00-00.mat").unlink()
    fewer = foot_recordings.task_vicon()
    assert fewer.note and len(fewer.split("test")) == 2
    assert sorted(task.files_sha256(walk) == "" for walk in task.split("test")) == [False, True, True]


@pytest.mark.data
def test_a_changed_file_is_named(copies: Path) -> None:
    name = next(file.path for file in datasets()["foot_vicon"].files if (copies.parent / file.path).is_file())
    path = copies.parent / name
    path.chmod(0o644)
    path.write_bytes(path.read_bytes() + b"\0")
    task = foot_recordings.task_vicon()
    with pytest.raises(DatasetError, match=f"{path.name}: sha256 is .* the file was changed"):
        for walk in task.split("test"):
            task.load(walk)


@pytest.mark.data
@pytest.mark.parametrize("make", [foot_recordings.task_vicon, foot_recordings.task_walks])
def test_the_reference_turns_as_the_foot_does(data_root: Path, make: Callable[[], Task]) -> None:
    """The frames are right-handed: where the path turns, the foot yaws the same way; mirrored, the other way.

    The yaw is the rate about the direction of specific force at rest, summed; the path is cut into legs of half a metre
    or more. Their correlation is 0.8 in the median over walks, and -0.8 were the frame mirrored.
    """
    task = make()
    if not (data_root / str(task.dataset)).is_dir():
        pytest.skip(f"{task.dataset} is not under PDRBENCH_DATA")
    agreement = []
    for walk in task.split("test"):
        recording = task.load(walk)
        way = recording.reference
        ends = [0]
        for row in range(len(way)):
            if np.hypot(*(way.xy_m[row] - way.xy_m[ends[-1]])) > 0.5:
                ends.append(row)
        x_m, y_m = np.diff(way.xy_m[ends], axis=0).T
        turn_rad = np.angle(np.exp(1j * np.diff(np.arctan2(y_m, x_m))))
        accel, gyro = (recording.streams[name].rows for name in ("accel", "gyro"))
        up = accel[:100, 1:].mean(axis=0)
        rate_radps = (gyro[:, 1:] - gyro[:100, 1:].mean(axis=0)) @ up / np.linalg.norm(up)
        yaw_rad = np.interp(way.t_s[ends], gyro[:, 0], np.cumsum(rate_radps * np.gradient(gyro[:, 0])))
        is_clear = np.abs(turn_rad) < 2.2  # about a half turn left and right look alike
        agreement.append(np.corrcoef(turn_rad[is_clear], (yaw_rad[2:] - yaw_rad[:-2])[is_clear])[0, 1])
    assert np.nanmedian(agreement) > 0.6  # NaN of lifts in place


@pytest.mark.data
def test_a_foot_stands_still_from_the_observation_to_the_end_of_its_stance(data_root: Path) -> None:
    """The assumption of `rests`, by motion capture: a resting foot moves by 1 mm (median) and at most 4 cm."""
    tables = sorted((data_root / "foot_stride_gcp" / "vicon_stride_labels").glob("*.csv"))
    trials = {path.stem: path for path in (data_root / "foot_vicon").rglob("*.mat")}
    pairs = [
        (table, trials[table.name.partition("_")[0]]) for table in tables if table.name.partition("_")[0] in trials
    ]
    if not pairs:
        pytest.skip("foot_stride_gcp and foot_vicon are not both under PDRBENCH_DATA")
    moved_m = []
    for table, trial in pairs[:10]:
        captured = foot_vicon.read(trial).reference
        end_s = captured.t_s[np.genfromtxt(table, delimiter=",", skip_header=1)[:, 0].astype(int)]
        seen_s = np.floor((end_s + 1e-6) / 0.05) * 0.05
        x_m, y_m = (np.interp(seen_s, captured.t_s, column) for column in captured.xy_m.T)
        at_end_m = captured.xy_m[np.searchsorted(captured.t_s, end_s)]
        moved_m.extend(np.hypot(x_m - at_end_m[:, 0], y_m - at_end_m[:, 1]))
    assert np.median(moved_m) < 0.002
    assert np.max(moved_m) < 0.04
